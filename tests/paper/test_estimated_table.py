"""Table 5 of given poses and keypoints, with a network in place of trainings."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from gmrdata.cli import main
from gmrdata.paper.comparison import TableRecord
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip, camera_of, save_clip
from gmrdata.values.files import read_json
from gmrdata.world.compose import motion_in_camera
from tests.paper.openpose_files import write_frames


def test_every_row_is_made_with_the_network_of_the_package(
    filmed: tuple[Clip, ...],
    small_body: BodyModel,
    write_set: Callable[..., Path],
    body_path: Path,
    tmp_path: Path,
) -> None:
    """With exact poses GMR's two rows agree, and VIBE-CAM's are what the camera sees."""
    clips = [replace(clip, motion=replace(clip.motion, shape=np.zeros(10))) for clip in filmed[:2]]
    manifest = write_set(tmp_path / "set", clips)
    for clip in clips:
        seen = motion_in_camera(clip.motion, camera_of(clip).world_from_cam)
        rest_pelvis_m = small_body.rest_pelvis_m(seen.shape)
        posed = replace(clip, motion=seen, camera=None)
        save_clip(tmp_path / "poses" / f"{clip.id}.npz", posed, rest_pelvis_m)
        write_frames(tmp_path / "keypoints" / clip.id, clip, small_body)
    command = ["tables", "5", "--scored", str(manifest), "--network", "bundled"]
    command += ["--poses", str(tmp_path / "poses"), "--keypoints", str(tmp_path / "keypoints")]
    command += ["--estimator", "Nobody", "--body", str(body_path), "--workers", "1"]
    main([*command, "--out", str(tmp_path / "out")])
    record = TableRecord.read(tmp_path / "out" / "table5.json")
    rows = {row.name: row.ours for row in record.rows}
    assert list(rows) == [
        "Nobody-CAM",
        "Ours(Nobody)",
        "Ours(GT input)",
        "true camera-frame poses as world poses",
        "no motion at all",
    ]
    assert (record.data.network, record.data.estimator) == ("bundled", "Nobody")
    text = (tmp_path / "out" / "table5.md").read_text()
    assert "GMR: network bundled, as it is." in text
    assert "Nobody: who estimates where the paper has VIBE." in text
    figures = {name: ours.model_dump() for name, ours in rows.items() if ours}
    for metric in ("ome_deg", "tme_mm", "vme_mm"):
        means = {name: figures[name][metric]["mean"] for name in figures}
        np.testing.assert_allclose(means["Ours(Nobody)"], means["Ours(GT input)"], rtol=1e-5)
        np.testing.assert_allclose(
            means["Nobody-CAM"], means["true camera-frame poses as world poses"], rtol=1e-3
        )
    scores = read_json(tmp_path / "out" / "scores" / "ours" / "scores.json")
    assert scores["overall"]["n_clips"] == 2
