"""Scores of a manifest: their numbers, groups and refusals."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from gmrdata.body.file import save_body
from gmrdata.body.model import BodyModel
from gmrdata.body.skin import motion_vertices_m
from gmrdata.cli import main
from gmrdata.clip import Clip, save_clip
from gmrdata.errors import BadManifest, StaleOutput
from gmrdata.evaluate import score, vertices
from gmrdata.evaluate.score import ScoreConfig, score_clips, score_manifest, summarise
from gmrdata.gmr.checkpoint import save_checkpoint
from gmrdata.gmr.config import ModelConfig
from gmrdata.gmr.infer import TrainedGmr, load_gmr
from gmrdata.gmr.model import Gmr
from gmrdata.gmr.motion_deltas import deltas
from gmrdata.gmr.usable import UsableClip
from gmrdata.manifest.current import Quality, Source
from gmrdata.manifest.entry import clip_entry
from gmrdata.manifest.write import write_manifest
from gmrdata.motion.gait import embedded_motions
from gmrdata.store import write_json

FLOOR_GROUP = {
    "sequences": 1,
    "accepted": 1,
    "class_right": 1,
    "n_motions": 9,
    "camera_rotation_deg": None,
    "camera_path_mm": None,
    "abs_scale_error_percent": None,
    "scale_stated": 0,
    "scale_within_2sigma": 0,
    "kept_share": 1.0,
    "seconds_per_frame": 1.0,
}
CAMERA_MOTIONS = ("circular", "linear", "circular")


@pytest.fixture(scope="module")
def clips(small_body: BodyModel) -> list[Clip]:
    motions = embedded_motions(
        small_body, np.random.default_rng(0), count=3, fps_hz=30.0, duration_s=2.0
    )
    made = []
    for i, motion in enumerate(motions):
        valid = np.ones(60, bool)
        valid[30 : 30 + 5 * i] = False
        made.append(Clip(f"clip_{i}", motion, valid, np.full(60, -1), None))
    return made


def write_clips(
    folder: Path,
    body: BodyModel,
    clips: list[Clip],
    qualities: dict[str, Quality] | None = None,
    kind: str = "motions",
) -> Path:
    entries = []
    for clip, camera_motion in zip(clips, CAMERA_MOTIONS, strict=False):
        path = folder / f"{clip.id}.npz"
        save_clip(path, clip, body.rest_pelvis_m(clip.motion.shape))
        entries.append(
            clip_entry(
                folder,
                clip_path=path,
                camera_motion=camera_motion,  # type: ignore[arg-type]
                licence="CC0-1.0",
                source=Source(dataset="gmrdata", sequence=clip.id),
                quality=(qualities or {}).get(clip.id),
            )
        )
    return write_manifest(
        folder / "manifest.yaml",
        name="scored",
        version="1.0.0",
        description="Clips to score.",
        kind=kind,
        licence="CC0-1.0",
        clips=entries,
    )


@pytest.fixture
def run_dir(tmp_path: Path) -> Path:
    torch.manual_seed(0)
    model = Gmr(ModelConfig(layers=1, hidden=6))
    optimizer = torch.optim.Adam(model.parameters())
    delta_rotmats, delta_m = model(torch.randn(1, 4, 92))
    (delta_rotmats.sum() + delta_m.sum()).backward()
    optimizer.step()
    save_checkpoint(tmp_path / "run", 1, model, optimizer, {"fps_hz": 10.0})
    return tmp_path / "run"


@pytest.fixture
def body_path(tmp_path: Path, small_body: BodyModel) -> Path:
    save_body(tmp_path / "body.npz", small_body)
    return tmp_path / "body.npz"


class Oracle:
    """Stands for a network that knows the answer, but for 1 deg of yaw and 10 mm to the front."""

    fps_hz = 10.0

    def __init__(self, clips: list[Clip]) -> None:
        self.by_pose = {}
        for clip in clips:
            for run in score.runs_at(clip, 10.0, all_phases=True):
                motion = run.motion
                self.by_pose[motion.local_rotmats.tobytes()] = deltas(
                    motion.root_rotmats, motion.pelvis_m
                )

    def predict(self, _: object, local_rotmats: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        delta_rotmats, delta_m = self.by_pose[np.ascontiguousarray(local_rotmats).tobytes()]
        angle_rad = np.deg2rad(1.0)
        c, s = np.cos(angle_rad), np.sin(angle_rad)
        yaw = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
        return delta_rotmats @ yaw, delta_m + np.array([0, 0, 0.01])


def test_known_errors_get_known_scores(
    clips: list[Clip], small_body: BodyModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And zero motion's score is the motion's own size, gaps left out."""
    oracle = Oracle(clips)
    monkeypatch.setattr("gmrdata.gmr.infer.predict_deltas", oracle.predict)
    usable = [UsableClip(clip, "linear") for clip in clips]
    scored, skipped = score_clips(oracle, small_body, usable, ScoreConfig())  # type: ignore[arg-type]
    assert skipped == {}
    # Frames 0, 3, ..., 57; then 0, ..., 27 and 35, ..., 59; then 0, ..., 27 and 40, ..., 58.
    assert [one.n_motions for one in scored] == [19, 9 + 8, 9 + 6]
    for one, clip in zip(scored, clips, strict=True):
        np.testing.assert_allclose(one.errors["gmr"]["ome_deg"], 1.0, atol=1e-9)
        np.testing.assert_allclose(one.errors["gmr"]["tme_mm"], 10.0, atol=1e-9)
        rows = np.arange(0, 30, 3)
        _, delta_m = deltas(clip.motion.root_rotmats[rows], clip.motion.pelvis_m[rows])
        steps_mm = 1000 * np.linalg.norm(delta_m, axis=1)
        np.testing.assert_allclose(one.errors["zero"]["tme_mm"][:9], steps_mm)


def test_vme_is_the_distance_between_placed_meshes(
    clips: list[Clip], small_body: BodyModel, run_dir: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Against meshes of the body model itself: M([dA, L], beta, dT), frame by frame."""
    from gmrdata.gmr.infer import predict_deltas

    monkeypatch.setattr(vertices, "CHUNK_BYTES", len(small_body.template_m) * 24 * 8 * 3)
    gmr = load_gmr(run_dir)
    (one,), _ = score_clips(gmr, small_body, [UsableClip(clips[0], "none")], ScoreConfig())
    (run,) = score.runs_at(clips[0], 10.0, all_phases=False)
    true_rotmats, true_m = deltas(run.motion.root_rotmats, run.motion.pelvis_m)
    rotmats, metres = predict_deltas(gmr, run.motion.local_rotmats)
    rows = slice(0, 19)
    part = replace(run.motion, local_rotmats=run.motion.local_rotmats[rows], root_rotmats=rotmats)
    meshes_m = motion_vertices_m(small_body, replace(part, pelvis_m=metres))
    true_meshes_m = motion_vertices_m(
        small_body, replace(part, root_rotmats=true_rotmats, pelvis_m=true_m)
    )
    expected_mm = 1000 * np.linalg.norm(meshes_m - true_meshes_m, axis=-1).mean(-1)
    np.testing.assert_allclose(one.errors["gmr"]["vme_mm"], expected_mm, rtol=1e-4)


def test_pooled_and_mean_of_clips_differ_as_they_should() -> None:
    def errors(clip_id: str, camera_motion: str, values: list[float]) -> score.ClipErrors:
        arrays = {metric: np.array(values) for metric in score.METRICS}
        return score.ClipErrors(clip_id, camera_motion, {"gmr": arrays, "zero": arrays})

    found = summarise(
        [
            errors("a", "linear", [1.0]),
            errors("b", "circular", [4.0, 4.0, 4.0]),
            errors("c", "linear", [7.0, 9.0]),
        ]
    )
    overall = found["overall"]
    assert (overall["n_clips"], overall["n_motions"]) == (3, 6)
    assert overall["pooled_over_motions"]["gmr"]["tme_mm"] == pytest.approx(29 / 6)
    assert overall["mean_of_clips"]["gmr"]["tme_mm"] == pytest.approx((1 + 4 + 8) / 3)
    assert found["camera_motion"]["linear"]["pooled_over_motions"]["zero"][
        "ome_deg"
    ] == pytest.approx(17 / 3)
    assert list(found["camera_motion"]) == ["circular", "linear"]
    assert [clip["gmr"]["vme_mm"] for clip in found["clips"]] == [1.0, 4.0, 8.0]


def test_scores_json(
    clips: list[Clip], small_body: BodyModel, run_dir: Path, body_path: Path, tmp_path: Path
) -> None:
    rejected = Quality(verdict="rejected", reasons=("too few points",))
    manifest_path = write_clips(tmp_path / "data", small_body, clips, {"clip_1": rejected})
    path = score_manifest(run_dir, manifest_path, body_path, tmp_path / "scores")
    assert path == tmp_path / "scores" / "scores.json"
    record = json.loads(path.read_text())
    assert [clip["id"] for clip in record["clips"]] == ["clip_0", "clip_2"]
    assert record["skipped"] == {"clip_1": "rejected: too few points"}
    assert set(record["camera_motion"]) == {"circular"}
    assert record["overall"]["n_motions"] == 19 + 15
    assert record["fps_hz"] == 10.0
    assert record["model"]["network"] == ModelConfig(layers=1, hidden=6).model_dump()
    before = path.read_bytes()
    assert score_manifest(run_dir, manifest_path, body_path, tmp_path / "scores") == path
    again = score_manifest(run_dir, manifest_path, body_path, tmp_path / "again")
    assert again.read_bytes() == before
    config = ScoreConfig(all_phases=True)
    with pytest.raises(StaleOutput, match="all_phases"):
        score_manifest(run_dir, manifest_path, body_path, tmp_path / "scores", config)
    score_manifest(run_dir, manifest_path, body_path, tmp_path / "scores", config, redo=True)
    record = json.loads(path.read_text())
    assert record["clips"][0]["n_motions"] == 3 * 19


def test_a_floor_is_part_of_what_was_asked(
    clips: list[Clip],
    small_body: BodyModel,
    run_dir: Path,
    body_path: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Beside scores that are far above it, and again beside the same below it."""
    manifest_path = write_clips(tmp_path / "data", small_body, clips, kind="pseudo_gt")
    out_dir, floor_path = tmp_path / "scores", tmp_path / "floor.json"

    def scored(own_mm: float, **options: Any) -> dict[str, Any]:
        group = FLOOR_GROUP | {"ome_deg": 1e-6, "tme_mm": own_mm, "vme_mm": own_mm}
        floor = {"format": "gmrdata-floor/1", "fps_hz": 10.0, "seed": None, "recipe": {}}
        floor |= {"sequences": [], "classes": {}, "overall": group}
        write_json(floor_path, floor)
        path = score_manifest(
            run_dir, manifest_path, body_path, out_dir, floor_path=floor_path, **options
        )
        return dict(json.loads(path.read_text()))

    above = scored(1e-3)
    assert above["statements"] == []
    assert above["overall"]["floor"]["tme_mm"] == above["clips"][0]["floor"]["tme_mm"] == 1e-3
    with pytest.raises(StaleOutput, match="floor"):
        scored(1e6)
    below = scored(1e6, redo=True)
    assert below["overall"]["below_floor"] == ["tme_mm", "vme_mm"]
    # Three clips, two classes, and all.
    assert len(below["statements"]) == 3 + 2 + 1
    assert below["overall"]["pooled_over_motions"] == above["overall"]["pooled_over_motions"]
    asked = ["evaluate", str(run_dir), str(manifest_path), "--out", str(out_dir)]
    main([*asked, "--body", str(body_path), "--floor", str(floor_path)])
    said = " ".join(capsys.readouterr().out.split())
    assert "pseudo ground truth's own" in said and "0.00 / 1000000.0 / 1000000.0 (all)" in said
    assert below["statements"][0] in said


def test_the_camera_does_not_matter(
    clips: list[Clip], small_body: BodyModel, run_dir: Path
) -> None:
    """The prediction for a clip is the same, whatever its root does."""
    gmr: TrainedGmr = load_gmr(run_dir)
    clip = clips[0]
    still = replace(clip.motion, root_rotmats=np.tile(np.eye(3), (60, 1, 1)))
    found = [
        score_clips(gmr, small_body, [UsableClip(one, "none")], ScoreConfig())[0][0]
        for one in (clip, replace(clip, motion=still))
    ]
    assert not np.allclose(found[0].errors["zero"]["ome_deg"], 0)
    np.testing.assert_allclose(found[1].errors["zero"]["ome_deg"], 0, atol=1e-9)


def test_clips_of_another_body_or_without_motions_are_refused(
    clips: list[Clip], small_body: BodyModel, run_dir: Path, body_path: Path, tmp_path: Path
) -> None:
    other = replace(clips[0], motion=replace(clips[0].motion, body="giant"))
    manifest_path = write_clips(tmp_path / "giant", small_body, [other])
    with pytest.raises(BadManifest, match="clip clip_0: of body giant"):
        score_manifest(run_dir, manifest_path, body_path, tmp_path / "scores")
    flicker = replace(clips[0], valid=np.arange(60) % 2 == 0)
    manifest_path = write_clips(tmp_path / "flicker", small_body, [flicker])
    with pytest.raises(BadManifest, match="no clip has two valid frames in a row"):
        score_manifest(run_dir, manifest_path, body_path, tmp_path / "scores")
    assert not (tmp_path / "scores").exists()
