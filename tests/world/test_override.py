"""A person's decision on verdicts, with sets of frames as the oracle."""

from itertools import groupby

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from gmrdata.values.errors import BadRecipe
from gmrdata.world.recipe import Dropped, Override, Verdict, overridden, verdict_of

N = 20
USABLE = np.zeros(N, dtype=bool)
NO_CAMERA = [""] * 15 + ["no camera was found"] * 5
REJECTED = verdict_of("c", False, ("60% of the images have a camera", "a cut"), NO_CAMERA)
ACCEPTED = verdict_of("c", True, (), NO_CAMERA)


@pytest.mark.parametrize(
    ("before", "decided", "because", "reasons"),
    [
        (
            REJECTED, "accepted", "the cut is a flash",
            ("a person decided: the cut is a flash",
             "overruled: 60% of the images have a camera", "overruled: a cut"),
        ),
        (ACCEPTED, "rejected", " the body floats ", ("a person decided: the body floats",)),
        (REJECTED, "rejected", "x", ("a person decided: x", *REJECTED.reasons)),
    ],
)  # fmt: skip
def test_a_person_decides_and_overruled_reasons_stay(
    before: Verdict, decided: str, because: str, reasons: tuple[str, ...]
) -> None:
    override = Override.model_validate({"verdict": decided, "because": because})
    verdict = overridden(before, override, USABLE)
    assert verdict == verdict_of("c", decided == "accepted", reasons, NO_CAMERA)
    assert verdict.dropped == before.dropped


def test_ranges_alone_leave_the_verdict_to_the_thresholds() -> None:
    override = Override(because="looked at it", keep=((14, 17),), drop=((0, 2), (16, 18)))
    unusable = np.arange(N) == 14
    reasons = ["" if row < 13 else "the camera jumps" for row in range(N)]
    for before in (REJECTED, ACCEPTED):
        lost_too = [a or b for a, b in zip(NO_CAMERA, reasons, strict=True)]
        judged = verdict_of("c", before.accepted, before.reasons, lost_too)
        verdict = overridden(judged, override, unusable)
        after = verdict.frame_reasons
        assert (verdict.accepted, verdict.reasons) == (before.accepted, before.reasons)
        said, jumps, lost = override.decision, "the camera jumps", "no camera was found"
        # 14 can't be kept, 16 is dropped by the person although they also keep it.
        assert verdict.dropped == (
            Dropped(0, 2, said),
            Dropped(13, 15, jumps),
            Dropped(16, 18, said),
            Dropped(18, 20, lost),
        )
        assert after == [said] * 2 + [""] * 11 + [jumps] * 2 + [""] + [said] * 2 + [lost] * 2
        assert verdict.kept.mean() == 12 / 20


def test_a_frame_that_cannot_be_used_says_so_even_where_nothing_had_a_reason() -> None:
    override = Override(because="all good", keep=((0, N),))
    unusable = np.arange(N) < 3
    verdict = overridden(verdict_of("c", True, (), [""] * N), override, unusable)
    assert verdict.dropped == (Dropped(0, 3, "the frame has no camera or no pose"),)
    assert [bool(reason) for reason in verdict.frame_reasons] == unusable.tolist()


def test_nobody_can_accept_a_sequence_without_frames() -> None:
    override = Override(verdict="accepted", because="I like it", drop=((0, 15),))
    verdict = overridden(REJECTED, override, np.arange(N) >= 15)
    assert not verdict.accepted
    assert verdict.kept.mean() == 0
    assert verdict.reasons[-1] == "no frame can be used"
    drop_all = Override(because="blurred", drop=((0, N),))
    verdict = overridden(ACCEPTED, drop_all, USABLE)
    assert (verdict.accepted, verdict.reasons) == (False, ("no frame can be used",))


def test_ranges_beyond_the_sequence_are_refused() -> None:
    override = Override(because="x", keep=((15, 21),))
    with pytest.raises(BadRecipe, match=r"keep 15\.\.21: the sequence has 20 frames"):
        overridden(ACCEPTED, override, USABLE)


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"verdict": "accepted"}, "because"),
        ({"verdict": "accepted", "because": "  "}, "at least 1 character"),
        ({"because": "nothing"}, "decides nothing"),
        ({"because": "x", "verdict": "good"}, "'accepted' or 'rejected'"),
        ({"because": "x", "keep": ((5, 5),)}, r"keep 5\.\.5 is empty"),
        ({"because": "x", "drop": ((-1, 5),)}, "greater than or equal to 0"),
        ({"because": "x", "drop": ((0, 5),), "kept": ()}, "kept"),
    ],
)
def test_an_override_that_makes_no_sense_is_refused(fields: dict[str, object], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        Override.model_validate(fields)


def test_an_override_comes_back_from_json() -> None:
    override = Override(verdict="rejected", because="x", keep=((1, 4),), drop=((2, 3), (7, 9)))
    assert Override.model_validate_json(override.model_dump_json()) == override


ranges = st.lists(
    st.tuples(st.integers(0, N - 1), st.integers(1, N)).filter(lambda part: part[0] < part[1]),
    max_size=4,
).map(tuple)
masks = st.lists(st.booleans(), min_size=N, max_size=N).map(np.array)
texts = st.lists(st.sampled_from(["", "", "jumps", "few inliers"]), min_size=N, max_size=N)


@given(
    keep=ranges,
    drop=ranges,
    unusable=masks,
    before=texts,
    decided=st.sampled_from(["accepted", "rejected"]),
)
def test_what_is_kept_is_what_sets_of_frames_say(
    keep: tuple[tuple[int, int], ...],
    drop: tuple[tuple[int, int], ...],
    unusable: np.ndarray,
    before: list[str],
    decided: str,
) -> None:
    override = Override.model_validate(
        {"verdict": decided, "because": "seen", "keep": keep, "drop": drop}
    )
    verdict = overridden(verdict_of("c", True, (), before), override, unusable)
    reasons = verdict.frame_reasons
    passed = {row for row in range(N) if not before[row]}
    expected = (passed | _rows(keep)) - _rows(drop) - set(np.flatnonzero(unusable))
    kept = {row for row in range(N) if not reasons[row]}
    assert kept == expected
    assert kept == set(range(N)) - _rows(tuple((d.start, d.stop) for d in verdict.dropped))
    assert verdict.kept.mean() == len(expected) / N
    assert verdict.accepted == (decided == "accepted" and bool(expected))
    # The ranges say the same as the texts, run by run.
    runs = [(reason, len(list(group))) for reason, group in groupby(reasons) if reason]
    assert runs == [(part.reason, part.stop - part.start) for part in verdict.dropped]
    # Nothing but the ranges of the person changes a frame, and twice is as once.
    for row in set(range(N)) - _rows(keep) - _rows(drop) - set(np.flatnonzero(unusable)):
        assert reasons[row] == before[row]
    assert overridden(verdict, override, unusable).dropped == verdict.dropped


def _rows(parts: tuple[tuple[int, int], ...]) -> set[int]:
    return {row for start, stop in parts for row in range(start, stop)}
