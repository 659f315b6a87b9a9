"""Measure the pose graph of cameras and a network, on twins of 3DPW whose cameras are taken away.

`make bench-fusion` runs this file alone; `--small` only tries every part.  The twins are those of
`make bench-sfm`, with their real pseudo ground truth; `--twins FOLDER`, `--pseudo-gt FOLDER`,
`--motions MANIFEST` and `--gmr RUN` take what is there.  The network was trained on none of the
people who move the twins, and its errors are measured on other people than the one who is put
together.  Prints tables and writes out/bench/fusion.json.
"""

from dataclasses import asdict
from statistics import fmean
from typing import Any

import numpy as np
import pytest
from fusion.gaps import (
    Case,
    Errors,
    cut_out,
    errors_of,
    fused_errors,
    interpolated_errors,
    made_noisy,
    network_errors,
    put_together,
    seen_rows,
    within_two_sigma,
)
from fusion.loops import loops
from fusion.session import FusionSession
from record import at_least, at_most
from render.tables import show

pytestmark = pytest.mark.bench
GAPS_S = (1.0, 2.0, 3.0)
GAPS_EACH = 3
NOISE_M = 0.015
SEED = 6


@pytest.fixture(scope="module")
def fusion(request: pytest.FixtureRequest) -> FusionSession:
    return FusionSession(
        small=request.config.getoption("--small"),
        twins_given=request.config.getoption("--twins"),
        pseudo_gt_given=request.config.getoption("--pseudo-gt"),
        run_given=request.config.getoption("--gmr"),
        motions_given=request.config.getoption("--motions"),
        cmu_dir=lambda: request.getfixturevalue("cmu_dir"),
    )


def test_gaps(fusion: FusionSession) -> None:
    rng, rows = np.random.default_rng(SEED), []
    for person in fusion.people:
        for seconds in (0.2,) if fusion.small else GAPS_S:
            for _ in range(GAPS_EACH):
                case = cut_out(fusion, person, seconds, rng)
                if case is not None:
                    rows.append(gap_row(fusion, case))
    show("Gaps, by person", [of_person(rows, name) for name in sorted({r["id"] for r in rows})])
    by_length = [summary(rows, s) for s in sorted({row["gap_s"] for row in rows})]
    show("Gaps, by length", by_length)
    whole = summary(rows, None)
    shares = {key: round(whole[key], 4) for key in ("place_in_2_sigma", "turn_in_2_sigma")}
    fusion.record.add(
        gaps=rows,
        gaps_by_length=by_length,
        gap_ratio_interpolation=whole["of_interpolation"],
        gap_ratio_gmr=whole["of_gmr"],
        in_2_sigma_share=min(shares.values()),
        **shares,
    )
    fusion.record.hold(
        [
            at_most("TME in gaps, of interpolation's", whole["of_interpolation"], 0.5),
            at_most("TME in gaps, of the network's alone", whole["of_gmr"], 0.8),
            at_least("errors in gaps within 2 sigma", min(shares.values()), 0.85),
        ]
    )


def gap_row(fusion: FusionSession, case: Case) -> dict[str, Any]:
    kinds = {"fused": fused_errors, "interpolated": interpolated_errors, "gmr": network_errors}
    errors: dict[str, Errors] = {name: of(fusion, case) for name, of in kinds.items()}
    start = int(case.hidden.argmax())
    row: dict[str, Any] = {"id": case.person.name, "gap_s": case.seconds, "start": start}
    row["motions"] = errors["fused"].motions
    row |= {f"{name}_tme_mm": round(one.tme_mm, 3) for name, one in errors.items()}
    row |= {f"{name}_ome_deg": round(one.ome_deg, 4) for name, one in errors.items()}
    within = within_two_sigma(case.person, case.fused, case.hidden)
    return row | {key: round(value, 4) for key, value in asdict(within).items()}


def of_person(rows: list[dict[str, Any]], name: str) -> dict[str, Any]:
    return {"id": name} | summary([row for row in rows if row["id"] == name], None)


def summary(rows: list[dict[str, Any]], seconds: float | None) -> dict[str, Any]:
    """Means over all motions of gaps, and over all frames of them."""
    chosen = [row for row in rows if seconds in (None, row["gap_s"])]
    weights = [row["motions"] for row in chosen]

    def mean(key: str) -> float:
        return float(np.average([row[key] for row in chosen], weights=weights))

    tme_mm = {name: mean(f"{name}_tme_mm") for name in ("fused", "interpolated", "gmr")}
    length = {} if seconds is None else {"gap_s": seconds}
    return length | {
        "gaps": len(chosen),
        **{f"{name}_tme_mm": round(value, 2) for name, value in tme_mm.items()},
        "of_interpolation": round(tme_mm["fused"] / tme_mm["interpolated"], 4),
        "of_gmr": round(tme_mm["fused"] / tme_mm["gmr"], 4),
        "ome_of_gmr": round(mean("fused_ome_deg") / mean("gmr_ome_deg"), 4),
        "place_in_2_sigma": round(mean("place"), 4),
        "turn_in_2_sigma": round(mean("turn"), 4),
        "place_error_mm": round(mean("place_error_mm"), 1),
        "place_sigma_mm": round(mean("place_sigma_mm"), 1),
    }


def test_noisy_cameras(fusion: FusionSession) -> None:
    rng = np.random.default_rng(SEED)
    rows: list[dict[str, Any]] = []
    for person in fusion.people:
        clip = made_noisy(person, NOISE_M, rng)
        seen = seen_rows(fusion, clip)
        fused = put_together(fusion, person, clip)
        motion, noisy = fused.clip.motion, clip.motion
        after = errors_of(fusion, person, motion.root_rotmats, motion.pelvis_m, seen)
        before = errors_of(fusion, person, noisy.root_rotmats, noisy.pelvis_m, seen)
        within = within_two_sigma(person, fused, fused.arrays["has_camera"])
        rows.append(
            {
                "id": person.name,
                "noise_found_mm": round(1000 * fused.noise.across_m, 2),
                "fused_tme_mm": round(after.tme_mm, 3),
                "unfused_tme_mm": round(before.tme_mm, 3),
                "place_in_2_sigma": round(within.place, 4),
                "turn_in_2_sigma": round(within.turn, 4),
            }
        )
    show(f"Cameras with {1000 * NOISE_M:g} mm of noise a frame", rows)
    means = [fmean(row[key] for row in rows) for key in ("fused_tme_mm", "unfused_tme_mm")]
    ratio = round(means[0] / means[1], 4)
    fusion.record.add(noisy=rows, noisy_ratio=ratio)
    fusion.record.hold([at_most("TME of noisy cameras, of the unfused", ratio, 0.6)])


def test_a_loop(fusion: FusionSession) -> None:
    found = loops(fusion)
    assert found or fusion.small
    if not found:
        return
    show("Loops", [asdict(one) for one in found])
    means = [fmean(getattr(one, key) for one in found) for key in ("network_m", "closed_m")]
    reduction = round(1 - means[1] / means[0], 4)
    fusion.record.add(loops=[asdict(one) for one in found], loop_reduction=reduction)
    fusion.record.hold([at_least("reduction of the end's error by a loop", reduction, 0.7)])
