"""COLMAP's mean reprojection error of exported models beside the stage's own."""

from pathlib import Path
from typing import Any

import cv2  # noqa: F401  (before pycolmap)
import pycolmap

from gmrdata.cameras.files import load_quality
from gmrdata.cli import main
from gmrdata.write.cameras import BINARY_FOLDER, TEXT_FOLDER

COLUMNS = ("sequence", "form", "stage_px", "colmap_px", "difference_share")


def compared(made_set: Path, out: Path) -> dict[str, Any]:
    """Export a regenerated set; the largest relative difference of sequences that have points."""
    main(["export", str(made_set), "--to", "colmap", "--out", str(out)])
    rows = []
    for sequence in sorted((made_set / "sequences").iterdir()):
        quality = load_quality(sequence / "sfm")
        if quality.geometry != "full":
            continue
        for form in (BINARY_FOLDER, TEXT_FOLDER):
            model = pycolmap.Reconstruction(str(out / "colmap" / sequence.name / form))
            model.update_point_3d_errors()
            (camera,) = model.cameras.values()
            # The stage counts pixels of the frames that it worked on.
            found_px = model.compute_mean_reprojection_error()
            found_px *= quality.worked_on_px[0] / camera.width
            stage_px = quality.mean_reprojection_px
            share = abs(found_px / stage_px - 1)
            rows.append((sequence.name, form, stage_px, found_px, share))
    return {
        "reprojection_difference_share": max(row[-1] for row in rows),
        "reprojection": [dict(zip(COLUMNS, row, strict=True)) for row in rows],
    }
