"""Which lens is taken: given, noted, shown by the frames, or guessed; and what is objected to."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from gmrdata.cameras.lens import intrinsics
from gmrdata.cameras.lens.intrinsics import (
    GivenIntrinsics,
    Intrinsics,
    IntrinsicsConfig,
    find_intrinsics,
    load_intrinsics,
)
from gmrdata.cameras.lens.self_calibration import SelfCalibration
from gmrdata.read.frames import read_frames
from gmrdata.values.errors import BadIntrinsics, BadRecord
from tests.read.test_intrinsics import jpeg_with

FOUND = SelfCalibration("full", 0.7, 0.02, -0.1, 0.01, (), "")
HIDDEN = SelfCalibration(None, None, np.inf, 0.0, np.inf, (), "the camera does not move")
UNASKED = IntrinsicsConfig(look_in_frames=False)


def made(
    folder: Path,
    *,
    given: GivenIntrinsics | None = None,
    config: IntrinsicsConfig = UNASKED,
    film_mm: int | None = None,
) -> Intrinsics:
    """The lens of two black frames, which may note one."""
    frames = folder / "frames"
    frames.mkdir(exist_ok=True)
    content = jpeg_with(folder, {} if film_mm is None else {0xA405: film_mm}).read_bytes()
    for number in range(2):
        (frames / f"{number:05d}.jpg").write_bytes(content)
    read = read_frames(frames)
    return load_intrinsics(find_intrinsics(read, None, folder / "out", config, given=given))


@pytest.fixture
def shown(monkeypatch: pytest.MonkeyPatch) -> Callable[[SelfCalibration], None]:
    """Let the frames show something."""

    def show(found: SelfCalibration) -> None:
        monkeypatch.setattr(intrinsics, "self_calibrate", lambda *_: found)

    return show


def test_what_is_given_is_taken(tmp_path: Path) -> None:
    lens = made(tmp_path, given=GivenIntrinsics(fov_deg=90.0))
    assert lens.source == "given" and lens.focal_px == pytest.approx(320.0)
    assert np.allclose(lens.lens.matrix_px, [[320, 0, 320], [0, 320, 240], [0, 0, 1]])
    assert lens.focal_observable is None and lens.asked is None and not lens.is_guess


def test_a_file_and_our_own_record_are_taken(tmp_path: Path) -> None:
    path = tmp_path / "cameras.txt"
    path.write_text("1 OPENCV 640 480 600 605 322 239 -0.15 0 0 0\n")
    lens = made(tmp_path, given=GivenIntrinsics(file=path))
    (tmp_path / "again").mkdir()
    own = GivenIntrinsics(file=tmp_path / "out" / "intrinsics.json")
    again = made(tmp_path / "again", given=own)
    assert (again.focal_px, again.focal_y_px, again.centre_px) == (600, 605, (322, 239))
    assert lens.radial_k1 == again.radial_k1 == -0.15
    assert lens.lens.radial == (-0.15, 0) and lens.lens.size_px == (640, 480)


def test_the_cameras_note_comes_next(tmp_path: Path) -> None:
    lens = made(tmp_path, film_mm=26)
    assert lens.source == "metadata" and lens.focal_sigma == 0.05
    assert lens.focal_px == pytest.approx(480.7, abs=0.1)
    assert made_given_wins(tmp_path / "given").source == "given"


def made_given_wins(folder: Path) -> Intrinsics:
    folder.mkdir()
    return made(folder, film_mm=26, given=GivenIntrinsics(focal_px=500.0))


def test_then_the_frames_and_then_a_guess_that_says_so(tmp_path: Path, shown: Any) -> None:
    (tmp_path / "a").mkdir()
    shown(FOUND)
    lens = made(tmp_path / "a", config=IntrinsicsConfig())
    assert lens.source == "self_calibrated" and lens.focal_px == pytest.approx(448.0)
    assert (lens.radial_k1, lens.radial_k1_sigma, lens.focal_observable) == (-0.1, 0.01, True)
    shown(HIDDEN)
    lens = made(tmp_path, config=IntrinsicsConfig())
    assert lens.source == "prior" and lens.is_guess and lens.focal_sigma == 0.3
    assert lens.focal_observable is False
    assert any("the camera does not move" in note for note in lens.notes)
    assert any("as uncertain" in note for note in lens.notes)


def test_a_guess_takes_the_little_that_the_frames_show(tmp_path: Path, shown: Any) -> None:
    # A pan of 7 degrees over a street: 1.16 to 11 %, where a usual lens has 0.85 to 30 %.
    weak = replace(FOUND, focal=1.16, focal_sigma=0.11, reason="only to 11 %")
    shown(weak)
    lens = made(tmp_path, config=IntrinsicsConfig())
    assert lens.source == "prior" and lens.focal_observable is False and lens.radial_k1 == 0
    share = 0.3**2 / (0.3**2 + 0.11**2)
    assert lens.focal_px == pytest.approx(640 * 1.16**share * 0.85 ** (1 - share))
    assert lens.focal_sigma == pytest.approx(0.3 * 0.11 / np.hypot(0.3, 0.11))
    assert "the little that the frames show" in lens.notes[0] and "±" not in lens.notes[0]
    (tmp_path / "less").mkdir()
    shown(replace(weak, focal_sigma=0.4))
    lens = made(tmp_path / "less", config=IntrinsicsConfig())
    assert lens.focal_px == pytest.approx(0.85 * 640) and "Nothing shows" in lens.notes[0]


@pytest.mark.parametrize("focal_px", [980.0, 635.0, 435.0 / 1.06])
def test_a_wrong_given_focal_length_is_objected_to(
    tmp_path: Path, shown: Any, focal_px: float
) -> None:
    shown(replace(FOUND, focal=435 / 640, focal_sigma=0.015))
    lens = made(tmp_path, config=IntrinsicsConfig(), given=GivenIntrinsics(focal_px=focal_px))
    assert lens.source == "given" and lens.focal_px == focal_px
    (objection,) = lens.objections
    assert "435 px ± 1.5 %" in objection and "not that of these frames" in objection


def test_a_right_one_and_a_rough_note_are_not(tmp_path: Path, shown: Any) -> None:
    shown(FOUND)
    given = GivenIntrinsics(focal_px=455.0)
    lens = made(tmp_path, config=IntrinsicsConfig(), given=given)
    assert not lens.objections and any("which agrees" in note for note in lens.notes)
    (tmp_path / "note").mkdir()
    lens = made(tmp_path / "note", config=IntrinsicsConfig(), film_mm=35)
    # The frames are firmer; that the two disagree makes the error wider.
    assert lens.source == "self_calibrated" and not lens.objections
    assert lens.focal_sigma > 0.3 and any("disagree" in note for note in lens.notes)


@pytest.mark.parametrize("given", [{}, {"focal_px": 500.0, "fov_deg": 60.0}, {"fov_deg": 180.0}])
def test_one_of_them_is_given(given: dict[str, float]) -> None:
    with pytest.raises(ValidationError):
        GivenIntrinsics(**given)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1 SIMPLE_PINHOLE 640 480 60 320 240", "No camera sees that"),
        ("1 SIMPLE_RADIAL 640 480 300 320 240 -0.3", "folds the corners"),
    ],
)
def test_a_lens_that_cant_be_is_refused(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "cameras.txt"
    path.write_text(text)
    with pytest.raises(BadIntrinsics, match=said):
        made(tmp_path, given=GivenIntrinsics(file=path))


def test_a_record_of_other_frames_or_without_a_key_is_refused(tmp_path: Path) -> None:
    made(tmp_path, given=GivenIntrinsics(focal_px=500.0))
    path = tmp_path / "out" / "intrinsics.json"
    value = json.loads(path.read_text())
    path.write_text(json.dumps(value | {"width_px": 320}))
    (tmp_path / "other").mkdir()
    with pytest.raises(BadIntrinsics, match="for 320x480 px, the frames have 640x480"):
        made(tmp_path / "other", given=GivenIntrinsics(file=path))
    del value["objections"]
    path.write_text(json.dumps(value))
    with pytest.raises(BadRecord, match="objections"):
        load_intrinsics(tmp_path / "out")


def test_a_filmed_arc_shows_its_lens(film: Any, tmp_path: Path) -> None:
    """From frames to record: nothing is given, and a wrong one would be objected to."""
    filmed = film("arc", 12)
    made_dir = find_intrinsics(
        filmed.taken(), filmed.masks_dir, tmp_path / "out", IntrinsicsConfig()
    )
    lens = load_intrinsics(made_dir)
    true_px = float(filmed.intrinsics_px[0, 0])
    assert lens.source == "self_calibrated" and lens.focal_observable
    assert lens.focal_sigma < 0.05
    assert abs(np.log(lens.focal_px / true_px)) < 2 * lens.focal_sigma
    assert not (made_dir / "colmap").exists()
