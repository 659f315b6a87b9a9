"""The pseudo ground truth's own error beside scores."""

from pathlib import Path
from typing import Any

import pytest

from gmrdata.manifest.write import ManifestHead, write_manifest
from gmrdata.score.records import PaperMetrics, Scores
from gmrdata.score.summary import beside_floor, read_fitting_floor
from gmrdata.score.table import score_rows
from gmrdata.twins.floor_record import Floor, FloorGroup
from gmrdata.values.errors import BadManifest, BadRecord
from gmrdata.values.files import write_json
from tests.score.score_records import clip_score, group_score, metrics
from tests.score.score_records import scores as score_record

INTERVALS = PaperMetrics[Any](ome_deg=None, tme_mm=(16.0, 19.96), vme_mm=None)


def group(ome_deg: float | None, tme_mm: float | None, vme_mm: float | None) -> FloorGroup:
    return FloorGroup(
        sequences=1,
        accepted=int(ome_deg is not None),
        class_right=1,
        n_motions=100,
        ome_deg=ome_deg,
        tme_mm=tme_mm,
        vme_mm=vme_mm,
        camera_rotation_deg=0.1,
        camera_path_mm=2.0,
        abs_scale_error_percent=None,
        scale_stated=0,
        scale_within_2sigma=0,
        kept_share=1.0,
        seconds_per_frame=0.5,
    )


def floor(**changes: Any) -> Floor:
    given = {
        "format": "gmrdata-floor/1",
        "fps_hz": 10.0,
        "seed": 0,
        "recipe": {},
        "sequences": (),
        "classes": {"linear": group(0.2, 4.0, 5.0), "static": group(None, None, None)},
        "overall": group(0.1, 3.0, 3.5),
    }
    return Floor.model_validate(given | changes)


def scores() -> Scores:
    clips = [
        clip_score("a", metrics(0.2, 3.999, 4.0), camera_motion="linear"),
        clip_score("b", metrics(0.09, 30.0, 40.0), camera_motion="static"),
        clip_score("c", metrics(1.0, 20.0, 30.0), camera_motion="circular"),
    ]
    whole = clip_score("all", metrics(0.4, 18.0, 25.0), n_motions=27)
    return score_record(clips, overall=group_score([whole], INTERVALS, n_clips=3))


def found_scores() -> Scores:
    found = beside_floor(scores(), floor())
    assert isinstance(found, Scores)
    return found


def test_each_row_gets_the_floor_of_its_class() -> None:
    found = found_scores().model_dump(mode="json")
    linear, static, circular = found["clips"]
    of_linear = {"of": "linear", "ome_deg": 0.2, "tme_mm": 4.0, "vme_mm": 5.0}
    of_all = {"of": "all", "ome_deg": 0.1, "tme_mm": 3.0, "vme_mm": 3.5}
    assert linear["floor"] == found["camera_motion"]["linear"]["floor"] == of_linear
    # No sequence of the one class was accepted, and the other class was not measured.
    assert static["floor"] == circular["floor"] == found["overall"]["floor"] == of_all
    # As large as the floor is not below it.
    assert linear["below_floor"] == ["tme_mm", "vme_mm"]
    assert static["below_floor"] == ["ome_deg"]
    assert circular["below_floor"] == found["overall"]["below_floor"] == []
    own = "not distinguishable from the pseudo ground truth's own error"
    said = "TME 4.00 mm is below 4.00 mm, VME 4.00 mm is below 5.00 mm"
    assert found["statements"] == [
        f"a: {said}: {own}",
        f"b: OME 0.090° is below 0.100°: {own}",
        f"all linear: {said}: {own}",
        f"all static: OME 0.090° is below 0.100°: {own}",
    ]
    assert found["clips"][0]["predicted"] == scores().clips[0].predicted.model_dump()


def test_the_table_has_the_floor_beside_gmr_and_zero_motion() -> None:
    headings, rows = score_rows(found_scores())
    assert headings[-2:] == ("with no motion at all", "pseudo ground truth's own")
    assert rows[0] == (
        "a", "9", "0.20", "4.0", "4.0", "0.01 / 0.0 / 0.0", "0.20 / 4.0 / 5.0 (linear)",
    )  # fmt: skip
    assert [row[0] for row in rows] == ["a", "b", "c", "all linear", "all static", "all circular",
                                        "all"]  # fmt: skip
    assert rows[-1][2:5] == ("0.40", "18.0 (16.0 to 20.0)", "25.0")
    assert rows[-1][-1] == "0.10 / 3.0 / 3.5 (all)"
    headings, rows = score_rows(scores())
    assert headings[-1] == "with no motion at all" and {len(row) for row in rows} == {6}


def manifest(folder: Path, kind: str) -> Path:
    return write_manifest(
        folder / "manifest.yaml",
        ManifestHead(
            name="scored",
            version="1.0.0",
            description="Clips to score.",
            kind=kind,
            licence="CC0-1.0",
        ),
        [],
    )


def test_a_floor_is_for_pseudo_ground_truth_of_its_rate(tmp_path: Path) -> None:
    path = tmp_path / "floor.json"
    write_json(path, floor().model_dump(mode="json"))
    pseudo = manifest(tmp_path / "pseudo", "pseudo_gt")
    assert read_fitting_floor(path, pseudo, "pseudo_gt", 10.0) == floor()
    with pytest.raises(BadRecord, match="at 10 fps, but the scores are at 30 fps"):
        read_fitting_floor(path, pseudo, "pseudo_gt", 30.0)
    with pytest.raises(BadManifest, match="of kind motions, but"):
        read_fitting_floor(path, tmp_path / "motions.yaml", "motions", 10.0)
    nothing = floor(overall=group(None, None, None)).model_dump(mode="json")
    write_json(path, nothing)
    with pytest.raises(BadRecord, match="no sequence was accepted"):
        read_fitting_floor(path, pseudo, "pseudo_gt", 10.0)
