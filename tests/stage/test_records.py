"""Records of stages: without any of their keys, and of other versions, they are refused."""

from pathlib import Path

import pytest

from gmrdata.people.folder import MasksRecord
from gmrdata.people.linking import Detection
from gmrdata.people.onnx import DetectionsRecord, FrameRecord
from gmrdata.stage.run import Run
from gmrdata.stage.store import (
    FileState,
    InputsRecord,
    KnownFile,
    RecipeRecord,
    StageRecord,
    run_stage,
)
from gmrdata.threedpw.intrinsics_check import FocalEstimate
from gmrdata.threedpw.regenerate import SequenceVerdict, Verdicts
from gmrdata.threedpw.sequence import PeopleRecord
from gmrdata.values.errors import StaleOutput
from gmrdata.values.files import read_json, write_json
from gmrdata.values.records import Config, Record
from tests.record_keys import assert_each_key_is_needed

VERDICT = SequenceVerdict("a_00", "test", True, (), "panning", 0.5, None, None)
FOCAL = FocalEstimate(1.0, 0.1, (0.0, 0.0), 2.0, 500)
RECIPE = RecipeRecord(stage="test", config={"seed": 1}, inputs={"a": "0" * 64})
FOUND: Detection = {"box_px": [0.0, 0.0, 2.0, 1.0], "score": 0.5, "class": 3}
RECORDS: tuple[Record, ...] = (
    RECIPE,
    StageRecord(
        **RECIPE.model_dump(exclude={"format", "host"}),
        facts={},
        gmrdata="1",
        git_commit=None,
        python="3",
        packages={},
        seconds=1.5,
    ),
    InputsRecord(files={"a": KnownFile("0" * 64, FileState(1, 2, 3, 4))}),
    PeopleRecord(bodies=(0,), genders=("female",), left_out=(), problems=(), focal=FOCAL),
    Verdicts(sequences=(VERDICT,)),
    MasksRecord(sources=("a",), masked_share={"0": {"a": 0.5}}, covered=(), unmasked=()),
    DetectionsRecord(frames={"0": FrameRecord([FOUND], [0], [[0.0, 0.0, 4.0, 2.0]])}),
)


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: type(record).__name__)
def test_each_key_of_a_record_is_needed(record: Record, tmp_path: Path) -> None:
    names = ("inputs", "packages", "config", "masked_share", "masked_share.0", "files", "frames")
    assert_each_key_is_needed(record, tmp_path / "record.json", names)


def test_a_folder_of_an_older_version_asks_for_redo(tmp_path: Path) -> None:
    out_dir = run_stage("test", tmp_path / "out", Config(), {}, lambda _: None)
    record = read_json(out_dir / "stage.json")
    del record["format"], record["facts"]
    write_json(out_dir / "stage.json", record)
    with pytest.raises(StaleOutput, match=r"stage\.json: has no `format`, .*older gmrdata.*--redo"):
        run_stage("test", out_dir, Config(), {}, lambda _: None)
    run_stage("test", out_dir, Config(), {}, lambda _: None, run=Run(redo=True))
    assert StageRecord.of(out_dir).facts == {}
