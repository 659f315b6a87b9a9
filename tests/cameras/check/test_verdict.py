"""What a lens that is not known leaves of a camera path, and which paths are out of order."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmrdata.cameras.check.verdict import lens_notes, lens_reasons, turn_spread_deg
from gmrdata.cameras.files import Geometry, SfmCameras
from gmrdata.cameras.lens.intrinsics import Intrinsics
from gmrdata.cameras.recipe import CamerasVerdictConfig
from gmrdata.values.camera import CameraPath, Source
from gmrdata.values.transforms import rigid

N = 41
CONFIG = CamerasVerdictConfig()


def pan(degrees: float, geometry: Geometry = "rotation_only") -> SfmCameras:
    """A camera that turns evenly; its last row has none."""
    angles = np.deg2rad(degrees) * np.linspace(-0.5, 0.5, N)
    turns = Rotation.from_rotvec(angles[:, None] * [0.0, 1.0, 0.0]).as_matrix()
    cameras = np.concatenate([rigid(turns, np.zeros(3)), np.full((1, 4, 4), np.nan)])
    path = CameraPath(np.diag([900.0, 900, 1]), 1280, 720, cameras, np.arange(N + 1) < N)
    return SfmCameras(path, geometry, np.arange(N + 1), np.zeros(N + 1, dtype=bool))


def lens(source: Source, sigma: float, objections: tuple[str, ...] = ()) -> Intrinsics:
    return Intrinsics(
        source=source,
        width_px=1280,
        height_px=720,
        focal_px=1088.0,
        focal_y_px=1088.0,
        focal_sigma=sigma,
        centre_px=(640.0, 360.0),
        radial_k1=0.0,
        radial_k1_sigma=None,
        focal_observable=source != "prior",
        asked=None,
        starts=(),
        objections=objections,
        notes=(),
    )


def test_the_spread_of_turns_is_that_about_their_mean() -> None:
    assert turn_spread_deg(pan(60.0).path.world_from_cam) == pytest.approx(
        60 / np.sqrt(12), rel=0.06
    )
    assert turn_spread_deg(np.full((3, 4, 4), np.nan)) == 0


def test_a_wide_pan_with_a_guessed_lens_rejects_and_a_small_one_only_says_so() -> None:
    guess = lens("prior", 0.3)
    (reason,) = lens_reasons(pan(60.0), guess, CONFIG)
    assert reason.startswith("the focal length is known to ±30% only, so the camera's turns, 17.")
    assert "are to ±5." in reason and "--focal" in reason
    assert list(lens_reasons(pan(6.0), guess, CONFIG)) == []
    (note,) = lens_notes(pan(6.0), guess)
    assert "1088 px, is a guess to ±30%" in note and "turns are to ±0.5 degrees" in note


def test_points_hold_the_turns_of_a_camera_that_travels_unless_its_lens_is_a_guess() -> None:
    wide, known = pan(150.0, "full"), lens("self_calibrated", 0.05)
    assert list(lens_reasons(wide, known, CONFIG)) == lens_notes(wide, known) == []
    assert len(list(lens_reasons(pan(150.0), known, CONFIG))) == 1
    assert len(list(lens_reasons(wide, lens("prior", 0.3), CONFIG))) == 1


def test_what_speaks_against_a_given_lens_is_a_reason() -> None:
    given = lens("given", 0.01, ("the frames ask for 435 px, not 635",))
    assert list(lens_reasons(pan(5.0), given, CONFIG)) == ["the frames ask for 435 px, not 635"]
