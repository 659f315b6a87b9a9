"""Measure the COLMAP stage on twins of 3DPW, beside the plain recipe, on broken input and videos.

`make bench-sfm` runs this file alone; `--small` only tries every part.  Twins are rendered once and
kept in out/bench/twins; `--twins FOLDER` takes others.  Prints tables and writes
out/bench/sfm.json.  Wall times are those of the stages' own records, one process for either side.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from record import at_least, at_most
from render.tables import show
from sfm.bars import bars_beside, own_bars
from sfm.beside import measure_beside, measure_ours, table_row
from sfm.breakages import break_sequence
from sfm.broken import measure_broken
from sfm.same import differences
from sfm.score import medians
from sfm.session import Session
from sfm.videos import measure_videos

pytestmark = pytest.mark.bench
RECIPE = "threedpw"
MOVING = ("circular", "linear", "linear_panning")


COLUMNS = ("id", "class_true", "class_measured", "accepted", "ome_deg", "tme_mm",
           "scale_error_percent", "scale_within_2sigma", "kept_share", "seconds")  # fmt: skip


def test_sequences(sfm: Session) -> None:
    twins, made = sfm.twins, sfm.made
    rows = [measure_ours(twins, name, made) for name in sorted(twins.classes)]
    show("Twins of 3DPW", [{key: row[key] for key in COLUMNS} for row in rows])
    middle = medians(rows)
    show("Medians", [middle])
    sfm.record.add(sequences=rows, own_medians=middle)
    sfm.record.hold([at_least("twin sequences", len(rows), 8), *own_bars(rows)])


def test_sequences_beside_the_plain_recipe(sfm: Session) -> None:
    twins, made = sfm.twins, sfm.made
    pairs = [
        measure_beside(twins, name, made, sfm.work_dir / "plain" / name)
        for name in sorted(twins.classes)
    ]
    show("Twins of 3DPW: ours / the plain recipe, at 10 fps", [table_row(pair) for pair in pairs])
    ours, plain = [pair.ours for pair in pairs], [pair.plain for pair in pairs]
    middle = {"ours": medians(ours), "plain": medians(plain)}
    show("Medians", [{"recipe": name} | row for name, row in middle.items()])
    speedup = ratio(plain, ours, "seconds")
    sfm.record.add(
        plain=plain,
        medians=middle,
        speedup=speedup,
        speedup_without_masks=ratio(plain, ours, "own_seconds"),
        speedup_by_sequence={pair.ours["id"]: pair.speedup for pair in pairs},
    )
    sfm.record.hold(
        [
            *bars_beside(ours, plain),
            at_least("times faster than the plain recipe", speedup, 5.0),
        ]
    )


def ratio(slow: list[dict[str, Any]], fast: list[dict[str, Any]], key: str) -> float:
    """Sum of a time over the slow rows, over that of the fast ones."""
    return round(sum(row[key] for row in slow) / sum(row[key] for row in fast), 2)


def test_a_long_sequence(sfm: Session) -> None:
    twins = sfm.long_twins
    name = next(iter(twins.classes))
    made = sfm.regenerate(twins.root, "long")
    pair = measure_beside(twins, name, made, sfm.work_dir / "plain" / name)
    show("A long sequence: ours / the plain recipe", [table_row(pair)])
    n_frames = made.clips(name)[0].motion.n_frames
    long = {"frames": n_frames, "ours": pair.ours, "plain": pair.plain, "speedup": pair.speedup}
    sfm.record.add(long=long)
    sfm.record.hold(
        [
            at_least("frames of the long sequence", n_frames, 300),
            at_least("times faster on it", pair.speedup, 10.0),
        ]
    )


def test_a_rolling_shutter(sfm: Session) -> None:
    """Each row of frames is exposed a little later than the row above, as phones do."""
    rows = []
    for readout in (0.0, 0.6):
        twins = sfm.rolling_twins(readout)
        made = sfm.regenerate(twins.root, f"rolling_{readout:g}")
        for name in sorted(twins.classes):
            ours = measure_ours(twins, name, made)
            keys = "accepted", "ome_deg", "tme_mm", "camera_path_mm", "camera_rotation_deg"
            kept = {"scale_error_percent": ours["scale_error_percent"], "kept": ours["kept_share"]}
            figures = {key: ours[key] for key in keys} | kept
            rows.append({"sequence": name, "readout_ms": round(readout * 1000 / 30), **figures})
    show("A rolling shutter", rows)
    sfm.record.add(rolling=rows)
    rejected = sum(not row["accepted"] for row in rows)
    sfm.record.hold([at_most("rejected for a rolling shutter", rejected, 0)])


def test_what_is_broken_is_caught(sfm: Session) -> None:
    twins = sfm.twins
    good, other = good_and_other(sfm)
    rng, masks_dir = np.random.default_rng(4), sfm.made.folder(good, "masks")
    out_dir = sfm.work_dir / "broken"
    broken = break_sequence(
        twins.files(good), masks_dir, twins.files(other), out_dir / "given", RECIPE, rng
    )
    rows = measure_broken(broken, out_dir, RECIPE)
    show(f"{good}, broken on purpose", rows)
    sfm.record.add(broken=rows, broken_from=[good, other])
    sfm.record.hold(
        [
            at_most("broken sequences that pass", sum(not row["caught"] for row in rows), 0),
            at_most("without the true cause", sum(not row["names_the_cause"] for row in rows), 0),
        ]
    )


def good_and_other(sfm: Session) -> tuple[str, str]:
    """An accepted sequence with a moving camera, and one of another place."""
    twins, verdicts = sfm.twins, sfm.made.verdicts
    moving = [name for name in sorted(twins.classes) if twins.classes[name] in MOVING]
    good = next((name for name in moving if verdicts[name].accepted), moving[0])
    places = twins.places
    return good, next(name for name in sorted(places) if places[name] != places[good])


def test_real_videos(sfm: Session, shared_data: Path) -> None:
    model = shared_data / "models" / "yolox_nano.onnx"
    dog, phone = rows = measure_videos(shared_data / "video", model, sfm.work_dir / "videos")
    show("Real videos", rows)
    sfm.record.add(videos=rows)
    sfm.record.hold(
        [
            at_most("dog: frames without a camera", dog["frames"] - dog["frames_with_camera"], 0),
            at_most("dog: mean reprojection error [px]", dog["mean_reprojection_px"], 1.0),
            at_most("static_people: camera extent [m]", phone["camera_extent_m"], 0.05),
        ]
    )


def test_runs_repeat(sfm: Session) -> None:
    names = sorted(sfm.twins.classes)
    rows: list[dict[str, Any]] = []
    for title, workers in (("the same seed again", 1), ("two workers", 2)):
        made = sfm.regenerate(sfm.twins.root, f"again_{workers}", workers=workers)
        differ = differences(sfm.made, made, names)
        rows.append({"run": title, "sequences": len(names), "differ": differ})
    show("Runs beside the first", rows)
    sfm.record.add(repeats=rows)
    sfm.record.hold([at_most("files that differ", sum(len(row["differ"]) for row in rows), 0)])
