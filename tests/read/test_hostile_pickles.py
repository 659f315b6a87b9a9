"""Sequence files that try to run something: refused by name, and nothing happens."""

import os
import pickle  # noqa: TID251  The tests write the pickles that must be refused.
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gmrdata.read.threedpw_files import read_sequence_file
from gmrdata.threedpw.regenerate import sequence_rows
from gmrdata.values.errors import BrokenPickle, UnsafePickle
from gmrdata.write.threedpw import sequence_bytes
from tests.damage import Calls, read_or_refused

NAME = "courtyard_walk_00"
TOUCHED = "touched"


@pytest.fixture
def here(tmp_path, monkeypatch) -> Path:
    """The folder in which a hostile pickle would leave its mark."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


SYSTEM = Calls(os.system, f"touch {TOUCHED}")
EVAL = Calls(eval, f"open({TOUCHED!r}, 'w')")
PLACES: dict[str, Callable[[dict[str, Any], Any], Any]] = {
    "the top": lambda c, call: call,
    "a value": lambda c, call: c | {"texture_maps": call},
    "a key": lambda c, call: [call, c],
    "a list": lambda c, call: c | {"poses": [call, c["poses"][1]]},
    "a tuple": lambda c, call: c | {"sequence": ((call,),)},
    "an object array": lambda c, call: c | {"poses": np.array([call, None], dtype=object)},
    "an object array in one": lambda c, call: (
        c | {"poses2d": [np.array([np.array([call, 0], dtype=object), 0], dtype=object), 0]}
    ),
    "a key that is not read": lambda c, call: c | {"notes": call},
}


@pytest.mark.parametrize("protocol", [0, 1, 2, 4, 5])
@pytest.mark.parametrize("place", sorted(PLACES))
@pytest.mark.parametrize("call", [SYSTEM, EVAL], ids=["system", "eval"])
def test_a_call_anywhere_in_a_sequence_is_refused_by_name(content, here, protocol, place, call):
    data = pickle.dumps(PLACES[place](content, call), protocol)
    (here / "some.pkl").write_bytes(data)
    with pytest.raises(UnsafePickle, match=r"some\.pkl: wants to import '\S+\.(system|eval)'"):
        read_sequence_file(here / "some.pkl")
    assert not (here / TOUCHED).exists()
    pickle.loads(data, encoding="latin1")  # the test's own check: it would have run
    assert (here / TOUCHED).exists()


def test_arrays_that_claim_absurd_sizes_are_refused_without_the_memory(here, walk_arrays):
    path = here / "some.pkl"
    path.write_bytes(sequence_bytes(walk_arrays))
    shape = b"(K\x1eK\x48t"  # (30, 72), the first array with that shape
    data = path.read_bytes()
    assert shape in data
    path.write_bytes(data.replace(shape, b"(J\xff\xff\xff\x7fJ\xff\xff\xff\x7ft"))
    with pytest.raises(BrokenPickle, match="lacks its bytes"):
        read_sequence_file(path)


@given(data=st.data())
def test_changed_bytes_give_arrays_or_an_error_that_says_so(walk_arrays, tmp_path_factory, data):
    """Whatever a few changed bytes make of a file: never another kind of error."""
    path = tmp_path_factory.getbasetemp() / "changed.pkl"
    path.write_bytes(sequence_bytes(walk_arrays))
    content = bytearray(path.read_bytes())
    structure = [match.start() for match in re.finditer(rb"cnumpy|cam_|poses|genders", content)]
    for _ in range(data.draw(st.integers(1, 3))):
        start = data.draw(st.sampled_from(structure))
        at = min(start + data.draw(st.integers(0, 120)), len(content) - 1)
        content[at] = data.draw(st.integers(0, 255))
    arrays = read_or_refused(path, bytes(content), read_sequence_file)
    if arrays is not None:
        assert arrays.cam_from_world.shape == (arrays.n_frames, 4, 4)
        assert all(person.poses_rad.shape == (arrays.n_frames, 72) for person in arrays.people)


def test_a_hostile_sequence_does_not_stop_the_others(make_dataset, here, content):
    root = make_dataset()
    hostile = root / "sequenceFiles" / "train" / "a_hostile_00.pkl"
    hostile.write_bytes(pickle.dumps(content | {"notes": SYSTEM}, 2))
    rows, n_bad = sequence_rows(root, "campose_valid")
    assert [row[0] for row in rows] == ["a_hostile_00", NAME] and n_bad == 1
    assert "system" in rows[0][-1] and rows[1][-1] == ""
    assert not (here / TOUCHED).exists()
