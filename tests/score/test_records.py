"""Records of scores, their tables and pages, and the pseudo ground truth's own error."""

import json
from pathlib import Path
from typing import Any

import pytest

from gmrdata.manifest.write import write_manifest
from gmrdata.pages.scores import scores_page
from gmrdata.score.compare import CompareConfig, Comparison, compare_records
from gmrdata.score.protocols import ORIGINAL, PROTOCOLS
from gmrdata.score.records import PaperMetrics, RowFloor, Scores
from gmrdata.score.summary import beside_floor, read_fitting_floor
from gmrdata.score.table import explanations, score_rows
from gmrdata.twins.floor_record import Floor, FloorGroup
from gmrdata.values.errors import BadManifest, BadRecord
from gmrdata.values.files import read_json_lines, write_json
from tests.clip_manifests import a_head
from tests.record_keys import assert_each_key_is_needed
from tests.score.score_records import clip_score, group_score, metrics, scores
from tests.score.score_records import scores as score_record

EMDB = PROTOCOLS["emdb"]
FLOOR = RowFloor(of="all", ome_deg=0.1, tme_mm=1.0, vme_mm=2.0)


def full(name: str = "run") -> Scores:
    """Scores with a protocol, a floor, types of motion and clips that were left out."""
    clips = [
        clip_score(
            id, metrics(0.4, 18.0, 25.0), camera_motion=kind, world=dict.fromkeys(EMDB.metrics, 1.5)
        ).model_copy(update={"motion_type": "walk", "floor": FLOOR, "below_floor": ("ome_deg",)})
        for id, kind in (("a", "linear"), ("b", "static"))
    ]
    found = scores(clips, name=name, protocol=EMDB)
    return found.model_copy(update={"skipped": {"c": "rejected"}})


def test_each_key_of_scores_is_needed(tmp_path):
    assert_each_key_is_needed(full(), tmp_path / "scores.json", ("skipped",), named_alone=True)


def test_a_clip_too_short_for_a_protocol_is_not_said_to_lack_a_camera():
    """It was counted among those whose figures in the camera's frame are missing."""
    tram, found = PROTOCOLS["tram"], metrics(0.4, 18.0, 25.0)
    seen = dict.fromkeys(tram.metrics, 1.5)
    alone = clip_score("a", found, world=seen | {"mpjpe_mm": None})
    short = clip_score("b", found, world=dict.fromkeys(tram.metrics))
    said = " ".join(explanations(scores([alone, short], protocol=tram)))
    assert "1 predictions have no camera of their own" in said
    own = clip_score("a", found, world=seen).model_copy(update={"seen_in": "own_camera"})
    assert "camera of their own" not in " ".join(explanations(scores([own, short], protocol=tram)))


def test_each_key_of_a_networks_scores_is_needed(tmp_path):
    network = {"kind": "network", "run": "gmr", "step": 3, "which": "best"}
    network |= {"network": {"layers": 1}}
    found = Scores.model_validate(dict(full()) | {"model": network})
    free = ("skipped", "model.network")
    assert_each_key_is_needed(found, tmp_path / "scores.json", free, named_alone=True)


def test_each_key_of_a_comparison_is_needed(tmp_path):
    both = [full("first"), full("other")]
    found = compare_records(both, [tmp_path, tmp_path], ["first", "other"], CompareConfig())
    assert_each_key_is_needed(found, tmp_path / "comparison.json", named_alone=True)


@pytest.mark.parametrize(
    ("record", "older"), [(Scores, "gmrdata-scores/3"), (Comparison, "gmrdata-comparison/2")]
)
def test_an_older_version_is_refused_with_the_remedy(record, older, tmp_path):
    path = tmp_path / "older.json"
    path.write_text(json.dumps({"format": older, "clips": []}))
    with pytest.raises(BadRecord, match=f"older.json: `format` is '{older}', .* with --redo"):
        record.read(path)


def test_what_does_not_fit_together_is_refused(tmp_path):
    path = tmp_path / "scores.json"
    full().write(path)
    whole = json.loads(path.read_text())
    changed = {
        "`camera_motion` has no key `circular`": {
            "clips": [whole["clips"][0] | {"camera_motion": "circular"}, *whole["clips"][1:]]
        },
        "some rows have a `floor`": {"overall": whole["overall"] | {"floor": None}},
        "`protocol` of a row does not fit": {"protocol": None},
        "`protocol.predicted` has an unknown key `jitter": {
            "protocol": whole["protocol"] | {"metrics": []}
        },
    }
    for said, change in changed.items():
        path.write_text(json.dumps(whole | change))
        with pytest.raises(BadRecord, match=said):
            Scores.read(path)


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


def scores_beside_floor() -> Scores:
    clips = [
        clip_score("a", metrics(0.2, 3.999, 4.0), camera_motion="linear"),
        clip_score("b", metrics(0.09, 30.0, 40.0), camera_motion="static"),
        clip_score("c", metrics(1.0, 20.0, 30.0), camera_motion="circular"),
    ]
    whole = clip_score("all", metrics(0.4, 18.0, 25.0), n_motions=27)
    return score_record(clips, overall=group_score([whole], INTERVALS, n_clips=3))


def found_scores() -> Scores:
    found = beside_floor(scores_beside_floor(), floor())
    assert isinstance(found, Scores)
    return found


def test_each_row_gets_the_floor_of_its_class():
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
    assert found["clips"][0]["predicted"] == scores_beside_floor().clips[0].predicted.model_dump()


def test_the_table_has_the_floor_beside_gmr_and_zero_motion():
    headings, rows = score_rows(found_scores())
    assert headings[-2:] == ("with no motion at all", "pseudo ground truth's own")
    assert rows[0] == (
        "a", "9", "0.20", "4.0", "4.0", "0.01 / 0.0 / 0.0", "0.20 / 4.0 / 5.0 (linear)",
    )  # fmt: skip
    assert [row[0] for row in rows] == ["a", "b", "c", "all linear", "all static", "all circular",
                                        "all"]  # fmt: skip
    assert rows[-1][2:5] == ("0.40", "18.0 (16.0 to 20.0)", "25.0")
    assert rows[-1][-1] == "0.10 / 3.0 / 3.5 (all)"
    headings, rows = score_rows(scores_beside_floor())
    assert headings[-1] == "with no motion at all" and {len(row) for row in rows} == {6}


def test_a_floor_is_for_pseudo_ground_truth_of_its_rate(tmp_path):
    path = tmp_path / "floor.json"
    write_json(path, floor().model_dump(mode="json"))
    pseudo = write_manifest(tmp_path / "pseudo.yaml", a_head("scored", "pseudo_gt"), [])
    assert read_fitting_floor(path, pseudo, "pseudo_gt", 10.0) == floor()
    with pytest.raises(BadRecord, match="at 10 fps, but the scores are at 30 fps"):
        read_fitting_floor(path, pseudo, "pseudo_gt", 30.0)
    with pytest.raises(BadManifest, match="of kind motions, but"):
        read_fitting_floor(path, tmp_path / "motions.yaml", "motions", 10.0)
    nothing = floor(overall=group(None, None, None)).model_dump(mode="json")
    write_json(path, nothing)
    with pytest.raises(BadRecord, match="no sequence was accepted"):
        read_fitting_floor(path, pseudo, "pseudo_gt", 10.0)


PAGE = (Path(__file__).parents[2] / "docs" / "metrics.md").read_text()
ROWS = {
    "PA-MPJPE": ("pa_mpjpe_mm",),
    "MPJPE": ("mpjpe_mm",),
    "PVE (EMDB calls it MVE)": ("pve_mm",),
    "PA-PVE": ("pa_pve_mm",),
    "MPJAE, PA-MPJAE": ("mpjae_deg", "pa_mpjae_deg"),
    "Accel error, of the difference m/s²": ("accel_error_m_per_s2",),
    "Accel error, of the difference mm/frame²": ("accel_error_mm_per_frame2",),
    "Accel, the prediction's own": ("accel_mm_per_frame2",),
    "Accel length error": ("accel_length_error_mm_per_frame2",),
    "W-MPJPE, WA-MPJPE": ("w_mpjpe_mm", "wa_mpjpe_mm"),
    "RTE": ("rte_percent",),
    "ROE": ("roe_deg",),
    "ERVE": ("erve_mm_per_frame",),
    "jitter": ("jitter_10m_per_s3",),
    "foot sliding": ("foot_sliding_mm",),
    "ATE, ATE-S": ("ate_m", "ate_s_m"),
}


def table(heading: str) -> list[list[str]]:
    """Cells of the first table under a heading, its headings first."""
    lines = PAGE.partition(f"## {heading}")[2].partition("\n## ")[0].splitlines()
    rows = [line.strip("|").split("|") for line in lines if line.startswith("|")]
    end = next((i for i, row in enumerate(rows[2:], 2) if set(row[0].strip()) <= {"-"}), len(rows))
    return [[cell.strip() for cell in row] for row in (rows[0], *rows[2 : min(end, len(rows))])]


@pytest.mark.parametrize("name", [name for name in PROTOCOLS if PROTOCOLS[name].metrics])
def test_the_table_has_the_protocols_metrics(name):
    headings, *rows = table("Protocols and their metrics")
    column, said = headings.index(name), set()
    for row in rows:
        metrics = ROWS.get(row[0]) or ROWS.get(f"{row[0]} {row[1]}")
        if len(row) == len(headings) and metrics and row[column]:
            said |= set(metrics)
    assert said == set(PROTOCOLS[name].metrics)  # type: ignore[index]


def test_each_deviation_has_its_option_and_protocols():
    _, *rows = table("Deviations, and the option that switches each")
    said = {row[0].strip("`"): set(row[1].split(", ")) for row in rows if "--" not in row[0]}
    known: dict[str, set[str]] = {}
    for name, deviations in ORIGINAL.items():
        for one in deviations:
            known.setdefault(one, set()).add(name)
    assert said == known


def _changed(path: Path, **changes: Any) -> Path:
    scores([clip_score("a", metrics(1.0, 2.0, 3.0))]).write(path)
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))
    return path


@pytest.mark.parametrize("key", ["predicted", "zero"])
def test_ragged_curves(key, tmp_path):
    path = _changed(tmp_path / "scores.json")
    content = json.loads(path.read_text())
    content["over_time"][key]["vertex_mm"].append(1.0)
    path.write_text(json.dumps(content))
    with pytest.raises(BadRecord, match=f"scores.json: `over_time` .*{key}` has 3 values for 2"):
        Scores.read(path)


@pytest.mark.parametrize("name", ["\ud800", "a\udfffb"])
def test_half_characters(name, tmp_path):
    path = _changed(tmp_path / "scores.json", name=name)
    with pytest.raises(BadRecord, match=r"scores\.json: .* half of a surrogate pair"):
        Scores.read(path)


@pytest.mark.parametrize("name", ["$", "a $\\frac$ b", "$x^$", "_hidden", "é <b>"])
def test_names_are_shown_as_they_are(name, tmp_path):
    page = scores_page(Scores.read(_changed(tmp_path / "scores.json", name=name)))
    shown = name.replace("<b>", "&lt;b&gt;")
    assert page.count(shown) >= 2  # in the heading and in the plot's legend


def test_lines_of_json(tmp_path):
    path = tmp_path / "metrics.jsonl"
    path.write_text('{"step": 1, "loss": 2.0}\n{"step": 2}\n')
    assert read_json_lines(path) == [{"step": 1, "loss": 2.0}, {"step": 2}]
    for junk in ("junk", "[1]", "\x00", '{"a": "\\ud800"}', "[" * 100_000):
        path.write_text('{"step": 1}\n' + junk)
        with pytest.raises(BadRecord, match=r"metrics\.jsonl:2: not a line of JSON"):
            read_json_lines(path)
