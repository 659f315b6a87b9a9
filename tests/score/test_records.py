"""Records of scores: each key counts, and an older version is refused."""

import json
from pathlib import Path

import pytest

from gmrdata.score.compare import CompareConfig, Comparison, compare_records
from gmrdata.score.protocols import PROTOCOLS
from gmrdata.score.records import RowFloor, Scores
from gmrdata.values.errors import BadRecord
from tests.record_keys import assert_each_key_is_needed
from tests.score.score_records import clip_score, metrics, scores

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


def test_each_key_of_scores_is_needed(tmp_path: Path) -> None:
    assert_each_key_is_needed(full(), tmp_path / "scores.json", free=("skipped",))


def test_each_key_of_a_networks_scores_is_needed(tmp_path: Path) -> None:
    network = {
        "kind": "network",
        "run": "gmr",
        "step": 3,
        "which": "best",
        "network": {"layers": 1},
    }
    found = Scores.model_validate(dict(full()) | {"model": network})
    free = ("skipped", "model.network")
    assert_each_key_is_needed(found, tmp_path / "scores.json", free)


def test_each_key_of_a_comparison_is_needed(tmp_path: Path) -> None:
    both = [full("first"), full("other")]
    found = compare_records(both, [tmp_path, tmp_path], ["first", "other"], CompareConfig())
    assert_each_key_is_needed(found, tmp_path / "comparison.json")


@pytest.mark.parametrize(
    ("record", "older"), [(Scores, "gmrdata-scores/3"), (Comparison, "gmrdata-comparison/1")]
)
def test_an_older_version_is_refused_with_the_remedy(
    record: type[Scores] | type[Comparison], older: str, tmp_path: Path
) -> None:
    path = tmp_path / "older.json"
    path.write_text(json.dumps({"format": older, "clips": []}))
    with pytest.raises(BadRecord, match=f"older.json: `format` is '{older}', .* with --redo"):
        record.read(path)


def test_what_does_not_fit_together_is_refused(tmp_path: Path) -> None:
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
            "protocol": whole["protocol"] | {"metrics": []},
        },
    }
    for said, change in changed.items():
        path.write_text(json.dumps(whole | change))
        with pytest.raises(BadRecord, match=said):
            Scores.read(path)
