"""The bars on real footage."""

from collections.abc import Iterator, Mapping, Sequence
from statistics import mean
from typing import Any

from real.cases import MASK_KINDS, Case
from record import Bar, at_least, at_most

FEWEST_CASES = 60
RPE_MM, RPE_DEG = 1.5, 0.04


def real_bars(
    cases: Sequence[Case], rows: Mapping[str, dict[str, Any]], summary: dict[str, Any]
) -> Iterator[Bar]:
    """Each figure that the issue names, where all of its cases were solved."""
    yield at_least("cases", len(rows), FEWEST_CASES)
    yield at_most("wrong acceptances", summary["wrong_acceptances"], 0)
    yield at_most("share of right results rejected", summary["right_rejected_share"], 0.1)
    for case in cases:
        if case.name in rows:
            yield from _case_bars(case, rows[case.name])
    yield from _window_bars(rows)


def _case_bars(case: Case, row: dict[str, Any]) -> Iterator[Bar]:
    accepted = row["accepted"]
    if case.must == "accepted":
        yield at_least(f"{case.name}: accepted", int(accepted), 1)
    if case.name.startswith("clip-dance-all"):
        yield at_most(f"{case.name}: RPE [mm]", row["rpe_mm"], RPE_MM)
        yield at_most(f"{case.name}: RPE [deg]", row["rpe_deg"], RPE_DEG)
    # What is rejected need not be exact.
    if accepted and case.most_ate_mm is not None:
        yield at_most(f"{case.name}: ATE [mm]", row["ate_mm"], case.most_ate_mm)
    if accepted and case.least_cameras:
        share = row["cameras"] / row["frames"]
        yield at_least(f"{case.name}: share with a camera", share, case.least_cameras)
    if row.get("plain_ate_mm") is not None:
        yield at_most(
            f"{case.name}: ATE beside plain [mm]", row["ate_mm"], 1.1 * row["plain_ate_mm"]
        )
        yield at_least(f"{case.name}: times as fast", row["speedup"], 5.0)


def _window_bars(rows: Mapping[str, dict[str, Any]]) -> Iterator[Bar]:
    for kind in MASK_KINDS:
        windows = [
            row
            for name, row in rows.items()
            if name.startswith("window-") and name.endswith(f"-{kind}")
        ]
        if len(windows) == 6:
            ates = [row["ate_mm"] for row in windows]
            known = None if None in ates else mean(ates)
            yield at_most(f"six windows, masks {kind}: mean ATE [mm]", known, 5.0)
            yield at_least("the same: cameras of 600", sum(row["cameras"] for row in windows), 600)
