"""Records beside motions: each key is required, and older files are named with the remedy."""

import pytest

from gmrdata.motion.cmu import RECORD, Fetched, FetchedFile, wanted_trials
from gmrdata.motion.emdb import EmdbAbout
from gmrdata.read.download import FetchConfig, PartNote
from gmrdata.values.errors import BadRecord
from gmrdata.values.records import Record
from tests.record_keys import assert_each_key_is_needed

RECORDS: list[Record] = [
    EmdbAbout(emdb1=True, emdb2=False, reasons=["", "good_frames_mask is False"]),
    Fetched(files={"02": FetchedFile(url="http://a/02.asf", size_bytes=3, sha256="ab")}),
    PartNote(url="http://a/02.asf", validator='"x"', size=None),
]


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: type(record).__name__)
def test_each_key_is_needed(record, tmp_path):
    assert_each_key_is_needed(record, tmp_path / "a.json", ("files",))


def test_a_list_of_fetched_files_without_a_tag_is_refused(tmp_path):
    (tmp_path / RECORD).write_text('{"files": {}}')
    with pytest.raises(BadRecord, match=r"fetched\.json: has no `format`.*--redo"):
        wanted_trials(["02_03"], tmp_path, FetchConfig())
