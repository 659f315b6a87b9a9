"""The verb video without any file of poses: the built-in estimator sees the people."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from gmrdata.cli import main
from gmrdata.fusion.record import FusionRecord
from gmrdata.read.systems.result import read_system
from gmrdata.read.video_files import NamedVideo
from gmrdata.solve.plan import plan_video
from gmrdata.solve.request import PeopleBySystem, SolveConfig, SolveRequest
from gmrdata.solve.verdict import VideoVerdict
from gmrdata.solve.videos import VideoBatch
from gmrdata.values.clip import load_clip
from tests.filming import CAMERAS_ALONE
from tests.fixtures.command_line import fails_cleanly
from tests.read import system_files

N_IMAGES, SIZE_PX = 12, (640, 360)
Shared = Callable[[str], Path]


@pytest.mark.slow
def test_people_of_a_real_video_stand_on_the_ground(shared_path, tmp_path):
    out = tmp_path / "out"
    verdict = solved(shared_path, tmp_path / "images", out, slice(None))
    assert len(verdict.people) >= 1
    assert any("size of the mean anny-2 body" in note for note in verdict.notes)
    seen = read_system(out / "own_poses" / "poses", "camera").people
    assert len(seen) == len(verdict.people)
    fused = FusionRecord.read(out / "fused" / "fusion.json")
    assert [one.frames for one in fused.people] == [N_IMAGES] * len(seen)
    for person in verdict.people:
        motion = load_clip(out / "pseudo_gt" / f"{person.id}.npz").motion
        known = np.isfinite(motion.pelvis_m[:, 0])
        # Whoever stands has the pelvis a leg above the floor, and is upright: by the focal length
        # that the pavement's and the houses' vanishing points ask for.  By 1.5 times it one stands
        # 0.3 m higher than the other.
        assert known.any() and (np.abs(motion.pelvis_m[known, 2] - 0.9) < 0.15).all()
        up = motion.root_rotmats[known][:, 2, 1]
        assert (up > 0.85).all()


def test_where_nobody_is_seen_there_are_cameras_alone(shared_path, tmp_path):
    """Which is not what `--poses own` asks for: it was accepted."""
    # Above their heads.
    verdict = solved(shared_path, tmp_path / "images", tmp_path / "out", slice(0, 64), "own")
    assert verdict.people == () and any("sees nobody" in note for note in verdict.notes)
    assert not (tmp_path / "out" / "pseudo_gt").exists()
    assert verdict.camera.accepted and verdict.reasons[0] == "none of the people can be used"


def solved(
    shared_path: Shared, images_dir: Path, out: Path, rows: slice, poses: str | None = None
) -> VideoVerdict:
    """The verb's verdict on small images of some rows of the real ones."""
    images_dir.mkdir()
    images = sorted(shared_path("video/static_people").glob("*.jpg"))[:N_IMAGES]
    for number, image in enumerate(images):
        small = cv2.resize(cv2.imread(str(image)), SIZE_PX, interpolation=cv2.INTER_AREA)
        cv2.imwrite(str(images_dir / f"{number:05d}.jpg"), small[rows])
    models = shared_path("models")
    command = ["video", images_dir, "--out", out, "--fps-hz", "15"]
    command += [] if poses is None else ["--poses", poses]
    command += ["--detector", models / "yolox_nano.onnx", "--focal", "325", "--no-check-lens"]
    command += ["--landmark-network", models / "pose_landmark_heavy.tflite", "--no-page"]
    main(list(map(str, command)))
    return VideoVerdict.read(out / "verdict.json")


def test_without_the_networks_people_are_left_out_with_a_word_or_refused(
    dolly, tmp_path, monkeypatch, gmrdata, works
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "empty"))
    flags = ("--out", tmp_path / "out", *CAMERAS_ALONE[:-2], "--fps-hz", "10", "--dry-run")
    command = ("video", dolly.images_dir, *flags)
    answer = works(*command)
    assert "own poses" not in answer.stdout
    said = " ".join(answer.stderr.split())
    assert "cameras alone, without people:" in said and "`gmrdata fetch models` gets it" in said
    fails_cleanly(gmrdata(*command, "--poses", "own"), "no such model file")


def test_a_batch_reads_the_estimator_s_networks(dolly, tmp_path):
    """Of videos whose people it looks for, and of no others."""
    files = {"landmarks": tmp_path / "net.tflite"}
    poses_path = system_files.write_joblib(tmp_path / "b.pkl", system_files.some_wham({0: 12}))
    own_people = PeopleBySystem(asked=False)
    request = SolveRequest(dolly.images_dir, own_people, fps_hz=10.0)
    batch = VideoBatch(tmp_path, request, SolveConfig(), own_files=files)
    own, theirs = (
        NamedVideo("a", dolly.images_dir),
        NamedVideo("b", dolly.images_dir, poses_path),
    )
    assert batch.inputs(own)["landmarks"] == tmp_path / "net.tflite"
    assert "landmarks" not in batch.inputs(theirs)
    assert batch.recipe(own).own_poses == "seen" and batch.recipe(theirs).own_poses == "no"
    seconds = [plan_video(batch.of(one), batch.config).seconds for one in (own, theirs)]
    assert seconds[0]["own poses"] > 0 == seconds[1]["own poses"]
