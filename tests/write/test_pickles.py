"""Pickles of plain data, read by this package and by pickle itself."""

import pickle  # noqa: TID251  The oracle: what others open the files with.
import pickletools
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from gmrdata.read.safe_pickle import load_plain
from gmrdata.write.pickles import python2_pickle, python3_pickle

TYPES = [np.float64, np.float32, np.int64, np.uint16, np.uint8, np.bool_, ">f8"]


def values(text: st.SearchStrategy[str]) -> st.SearchStrategy[Any]:
    arrays = hnp.arrays(
        st.sampled_from(TYPES),
        hnp.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4),
        elements=st.sampled_from([0, 1]),
    )
    return st.recursive(
        st.integers(-(1 << 31), (1 << 31) - 1) | st.booleans() | text | arrays,
        lambda inner: st.lists(inner) | st.dictionaries(st.text("abc") | st.integers(0, 9), inner),
        max_leaves=8,
    )


@given(value=values(st.text(st.characters(max_codepoint=255), max_size=300)))
def test_values_of_python_2_survive_for_both_readers(value, tmp_path_factory):
    path = tmp_path_factory.getbasetemp() / "value2.pkl"
    path.write_bytes(python2_pickle(value))
    for found in (load_plain(path), pickle.loads(path.read_bytes(), encoding="latin1")):
        np.testing.assert_equal(found, value)


@given(value=values(st.text(st.characters(exclude_categories=["Cs"]), max_size=300)))
def test_values_of_python_3_need_no_encoding(value, tmp_path_factory):
    path = tmp_path_factory.getbasetemp() / "value3.pkl"
    path.write_bytes(python3_pickle(value))
    for found in (load_plain(path), pickle.loads(path.read_bytes())):
        np.testing.assert_equal(found, value)


def names_of_numpy_alone(data: bytes) -> list[Any]:
    """The opcodes of a pickle, which imports three names and nothing else."""
    opcodes = list(pickletools.genops(data))
    assert {argument for opcode, argument, _ in opcodes if opcode.name == "GLOBAL"} == {
        "numpy ndarray",
        "numpy dtype",
        "numpy.core.multiarray _reconstruct",
    }
    return opcodes


def test_python_3_files_import_three_names_of_numpy():
    opcodes = names_of_numpy_alone(python3_pickle({"a": [np.zeros(3)], "b": "x", "c": True}))
    assert opcodes[0][1] == 4


@pytest.mark.parametrize("make", [python2_pickle, python3_pickle])
@pytest.mark.parametrize(
    "value", [None, 1.5, (1,), {1, 2}, b"x", 1 << 40, np.array([None]), np.array(["x"])]
)
def test_nothing_else_is_written(value, make):
    with pytest.raises(ValueError):
        make(value)


def test_python_2_has_no_other_alphabets():
    with pytest.raises(ValueError):
        python2_pickle("日")
