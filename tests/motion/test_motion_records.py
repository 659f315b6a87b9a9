"""Records beside motions: each key is required, and older files are named with the remedy."""

import json

import pytest

from gmrdata.motion.cmu import RECORD, Fetched, FetchedFile, wanted_trials
from gmrdata.motion.emdb import EmdbAbout
from gmrdata.read.download import FetchConfig, PartNote
from gmrdata.values.errors import BadRecord
from gmrdata.values.records import Record

RECORDS: list[Record] = [
    EmdbAbout(emdb1=True, emdb2=False, reasons=["", "good_frames_mask is False"]),
    Fetched(files={"02.asf": FetchedFile(url="http://a/02.asf", size_bytes=3, sha256="ab")}),
    PartNote(url="http://a/02.asf", validator='"x"', size=None),
]


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: type(record).__name__)
def test_each_key_is_required(record, tmp_path):
    path = tmp_path / "a.json"
    record.write(path)
    assert type(record).read(path) == record
    whole = json.loads(path.read_text())
    for key in type(record).model_fields:
        path.write_text(json.dumps({k: value for k, value in whole.items() if k != key}))
        with pytest.raises(BadRecord, match=rf"a\.json: has no .*`{key}`.*--redo"):
            type(record).read(path)
    for key in whole.get("files", {}).get("02.asf", ()):
        less = {k: value for k, value in whole["files"]["02.asf"].items() if k != key}
        path.write_text(json.dumps(whole | {"files": {"02.asf": less}}))
        with pytest.raises(BadRecord, match=rf"a\.json: has no .*{key}`"):
            Fetched.read(path)


def test_a_list_of_fetched_files_without_a_tag_is_refused(tmp_path):
    (tmp_path / RECORD).write_text('{"files": {}}')
    with pytest.raises(BadRecord, match=r"fetched\.json: has no `format`.*--redo"):
        wanted_trials(["02_03"], tmp_path, FetchConfig())
