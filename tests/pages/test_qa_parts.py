"""Parts of the QA pages: hostile texts stay texts, paths are aligned, reasons are of a kind."""

from functools import partial
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from gmrdata.pages.batches import page_name, write_pages
from gmrdata.pages.solved import (
    KIND_COLOURS,
    OTHER_COLOUR,
    SolvedSequence,
    align_dataset_camera,
    counts_of,
    example_frames,
    kinds_of,
)
from gmrdata.threedpw.recipe import SetPaths, ThreedpwRecipe
from gmrdata.threedpw.regenerate import SequenceVerdict
from gmrdata.values import transforms
from gmrdata.world.judge import window_differences
from tests.pages.html_pages import Page

HOSTILE = (
    "<script>alert(1)</script>",
    "\"><img src=x onerror='alert(1)'>",
    "../../evil",
    "/etc/passwd",
    "javascript:alert(1)",
    "$\\frac{",
    "</title></style><b>",
    "caf\udce9",
    "~0123456789abcdef",
    "",
)


def test_hostile_names_and_reasons_stay_texts(tmp_path):
    verdicts = [
        SequenceVerdict(name, name, False, (f"{name} | {HOSTILE[0]}",), "none", 0.0, None, None)
        for name in HOSTILE
    ]
    reasons = {name: f"{name}\n  {name}\n<i>trace</i>" for name in HOSTILE}
    paths = SetPaths(tmp_path / "out")
    write_pages(verdicts, (), reasons, ThreedpwRecipe(recipe="threedpw"), paths)
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    index = Page(paths.index_page)
    assert index.tags.count("script") == 1 and index.tags.count("tr") == 1 + len(HOSTILE)
    pages = [file for file in index.files if file.suffix == ".html"]
    assert sorted(pages) == sorted(paths.pages_dir.iterdir()) and len(pages) == len(HOSTILE)
    for name, path in zip(HOSTILE, pages, strict=True):
        page = Page(path)
        assert {"script", "img", "b", "i"}.isdisjoint(page.tags)
        assert "onerror" not in page.attributes
        shown = name.encode("utf-8", "backslashreplace").decode()
        assert shown in page.words and "<i>trace</i>" in page.words
        assert all(link.startswith("../index.html") for link in page.links)


@given(st.text(max_size=40))
def test_a_page_is_always_a_plain_file_of_its_folder(name):
    made = page_name(name)
    assert Path("qa", made).parent == Path("qa") and made.endswith(".html")
    assert made.isascii() and not made.startswith(".")


@given(st.lists(st.text(max_size=8), min_size=2, max_size=20, unique=True))
def test_two_names_never_share_a_page(names):
    assert len({page_name(name) for name in names}) == len(names)


def test_a_scale_that_no_camera_has_is_listed_without_its_share():
    """A set with one such sequence, which is rejected, had no pages and no table."""
    scaled = partial(SequenceVerdict, "a", "test", False, ("no scale",), "linear", 0.0)
    words = [scaled(scale, 0.03).scale_words for scale in (None, 0.0, -0.5, 0.5)]
    assert words == ["", "0", "-0.5", "0.5 ± 6.0 %"]
    assert scaled(0.0, 0.03).table_row[5] == "0" and scaled(None, None).table_row[5] == "-"


def test_people_without_a_verdict_are_not_accepted():
    """A record of cameras without people had no page."""
    found = SolvedSequence(name="a", reasons=(("", "no pose"), ("",)), dataset=Mock())
    assert found.accepted == [False, False]


def test_reasons_that_differ_in_a_number_are_of_one_kind():
    reasons = [
        ["", "image_00001.jpg is missing", "image_00002.jpg is missing", "the camera jumps", ""],
        ["", "", "no camera was found", "the camera jumps", "the camera jumps"],
    ]
    kinds = kinds_of(reasons)
    words = [kind.words for kind in dict.fromkeys(kinds.values())]
    assert words == ["image_….jpg is missing", "the camera jumps", "no camera was found"]
    assert {kind.words: n for kind, n in counts_of(reasons).items()} == {
        "the camera jumps": 3, "image_….jpg is missing": 2, "no camera was found": 1,
    }  # fmt: skip
    # The second person's jump is not asked for: the first has one already.
    assert {kind.words: at for kind, at in example_frames(reasons).items()} == {
        "image_….jpg is missing": 2, "the camera jumps": 3, "no camera was found": 2,
    }  # fmt: skip


def test_further_kinds_share_the_last_colour():
    names = [f"reason {chr(97 + i)}" for i in range(len(KIND_COLOURS) + 2)]
    colours = [kind.colour for kind in kinds_of([names]).values()]
    assert colours == [*KIND_COLOURS, OTHER_COLOUR, OTHER_COLOUR]


def moving_camera() -> np.ndarray:
    """(20, 4, 4) world_from_cam of a camera that goes and turns."""
    angles = np.linspace(0, 0.7, 20)[:, None] * np.array([0.2, 1.0, 0.1])
    places_m = np.c_[np.linspace(0, 2, 20), np.sin(np.linspace(0, 3, 20)), np.full(20, 1.5)]
    return transforms.rigid(Rotation.from_rotvec(angles).as_matrix(), places_m)


@given(
    arrays(float, 3, elements=st.floats(-3, 3)),
    arrays(float, 3, elements=st.floats(-50, 50)),
    st.booleans(),
)
def test_a_rigidly_moved_path_is_laid_back(rotvec, shift_m, in_place):
    ours = moving_camera()
    if in_place:
        ours[:, :3, 3] = 0.0
    other = transforms.rigid(Rotation.from_rotvec(rotvec).as_matrix(), shift_m)
    theirs = other @ ours
    theirs[3] = np.nan
    aligned = align_dataset_camera(ours, theirs, np.arange(20) < 15)
    assert aligned is not None and aligned.n_frames == 14
    assert aligned.rms_m < 1e-9 and aligned.rms_deg < 1e-5
    known = np.arange(20) != 3
    assert np.abs(aligned.world_from_cam[known] - ours[known]).max() < 1e-9
    assert np.isnan(aligned.world_from_cam[3]).any()


def test_a_difference_is_measured_in_metres_and_never_scaled_away():
    ours = moving_camera()
    theirs = ours.copy()
    theirs[:, :3, 3] *= 1.5
    aligned = align_dataset_camera(ours, theirs, np.full(20, True))
    assert aligned is not None
    spread_m = np.sqrt((np.var(ours[:, :3, 3], axis=0)).sum())
    assert aligned.rms_m == pytest.approx(0.5 * spread_m, rel=1e-6)
    assert align_dataset_camera(ours, theirs, np.full(20, False)) is None


def test_window_differences_are_those_of_the_moves():
    ours = moving_camera()
    theirs = ours.copy()
    turn = transforms.rigid(Rotation.from_rotvec([0, 0, np.deg2rad(3)]).as_matrix(), np.zeros(3))
    theirs[10:] = theirs[10:] @ turn
    apart_deg, apart_m = window_differences(ours, theirs, 5)
    assert apart_deg.shape == (15,)
    # Up to the turn the two move alike; over it, they differ by it, and the way is the same.
    assert np.allclose(apart_deg[:5], 0, atol=1e-6) and np.allclose(apart_deg[5:10], 3.0)
    assert np.allclose(apart_m[:10], 0, atol=1e-12)
    # After it the same way is seen in axes that are turned.
    expected_m = 2 * np.sin(np.deg2rad(1.5)) * np.linalg.norm(_across(ours)[10:], axis=1)
    assert np.allclose(apart_m[10:], expected_m)
    assert window_differences(ours[:3], theirs[:3], 5)[0].shape == (0,)


def _across(world_from_cam: np.ndarray) -> np.ndarray:
    """(T - 5, 2) ways over five frames, across the camera's optical axis [m]."""
    moves = transforms.invert(world_from_cam[:-5]) @ world_from_cam[5:]
    return np.asarray(moves[:, :2, 3])


def test_the_focal_row_follows_the_check():
    from gmrdata.pages.thresholds import focal_row
    from gmrdata.threedpw.intrinsics_check import (
        FocalEstimate,
        IntrinsicsCheckConfig,
        intrinsics_reason,
    )

    config = IntrinsicsCheckConfig()
    for factor, sigma in ((1.0, 0.01), (1.12, 0.01), (1.14, 0.01), (0.8, 0.05), (0.7, 0.05)):
        estimate = FocalEstimate(factor, sigma, (0.0, 0.0), 1.0, 500)
        assert focal_row(estimate, config).met == (intrinsics_reason(estimate, config) is None)
    assert focal_row(None, config).met is None
