"""What this project exports in WHAM's and GVHMR's layout is scored as no error."""

import numpy as np

from gmrdata.read.systems.result import read_system
from gmrdata.values.files import write_bytes
from gmrdata.write.systems import TrackedPerson, gvhmr_bytes, wham_bytes
from tests.score.test_results import FRAMES, N, body, data, only, rest, score, true

__all__ = ["body", "data", "true"]  # fixtures


def test_what_this_project_exports_is_scored_as_no_error(tmp_path, data, body, true):
    """Their camera's frame too, so that figures there are of its own camera."""
    rows = np.arange(N) != 30
    person = TrackedPerson(true.motion, rest(body, true), rows, FRAMES, true.camera)
    (tmp_path / "wham").mkdir()
    write_bytes(tmp_path / "wham" / "wham_output.pkl", wham_bytes([person]))
    scores = only(score(data, tmp_path / "wham", tmp_path / "a", protocol="wham", missing="drop"))
    clip = scores.clips[0]
    assert clip.dropped_frames == 1 and clip.seen_in == "own_camera"
    assert clip.predicted.tme_mm < 1e-2 and clip.predicted.vme_mm < 1e-2
    assert clip.protocol is not None and (clip.protocol.predicted["mpjpe_mm"] or 1) < 1e-2


def test_a_video_of_gvhmr_keeps_the_frames_that_count(tmp_path, true, body):
    valid = np.arange(N) > 3
    person = TrackedPerson(true.motion, rest(body, true), valid, np.arange(N), true.camera)
    path = tmp_path / "hmr4d_results.pt"
    write_bytes(path, gvhmr_bytes(person))
    (found,) = read_system(path, "world").people
    assert found.frame_numbers.tolist() == list(range(4, N))
    assert found.in_world is not None and true.camera is not None
    assert found.in_world.z_up_from_cam is not None
    np.testing.assert_allclose(
        found.in_world.z_up_from_cam[:, :3, :3], true.camera.world_from_cam[4:, :3, :3], atol=1e-6
    )
