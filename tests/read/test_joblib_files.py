"""Reading joblib's files as plain data, and refusing what is hidden in them."""

import bz2
import gzip
import lzma
import pickle  # noqa: TID251  The tests write the pickles that are to be read.
import zlib
from base64 import b64decode
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from gmrdata.read.safe_pickle import load_plain
from gmrdata.values import limits
from gmrdata.values.errors import BrokenPickle, UnsafePickle
from tests.damage import Calls
from tests.joblib_layout import joblib_bytes

DTYPES = st.sampled_from(["<f8", ">f4", "<i4", ">u2", "|u1", "?", "<U2", "<f2"])
PACKERS: dict[str, Callable[[bytes], bytes]] = {
    "as it is": bytes,
    "zlib": lambda data: zlib.compress(data, 3),
    "gzip": gzip.compress,
    "bz2": bz2.compress,
    "xz": lzma.compress,
    "lzma": lambda data: lzma.compress(data, format=lzma.FORMAT_ALONE),
}


BY_JOBLIB = (
    "gASV4QAAAAAAAAB9lEsBfZQojARwb3NllIwTam9ibGliLm51bXB5X3BpY2tsZZSMEU51bXB5QXJyYXlXcmFwcGVy"
    "lJOUKYGUfZQojAhzdWJjbGFzc5SMBW51bXB5lIwHbmRhcnJheZSTlIwFc2hhcGWUSwJLA4aUjAVvcmRlcpSMAUOU"
    "jAVkdHlwZZRoCYwFZHR5cGWUk5SMAmY0lImIh5RSlChLA4wBPJROTk5K/////0r/////SwB0lGKMCmFsbG93X21t"
    "YXCUiIwbbnVtcHlfYXJyYXlfYWxpZ25tZW50X2J5dGVzlEsQdWID////AAAAAAAAgD8AAABAAABAQAAAgEAAAKBA"
    "lVEAAAAAAAAAjAlmcmFtZV9pZHOUaAUpgZR9lChoCGgLaAxLAoWUaA5oD2gQaBKMAmk4lImIh5RSlChLA2gWTk5O"
    "Sv////9K/////0sAdJRiaBiIaBlLEHViDf////////////////8EAAAAAAAAAAUAAAAAAAAAdXMu"
)
BY_JOBLIB_PACKED = (
    "eF5lUDtPw0AMbl6i5VlAQiD+QFk6MTAgUcTGSZFgYYwuTYoDl+SUS4QyVEoHoEi34e78NX4JOA9g4NPZZ/v8yZ+v"
    "slefvRZzZMYcR9qWqQpR7z+kvoj8cVLEsvRkNH0UVN116/Qyy3h5l3Epwwzf8WSBNbGvCn8quFKonYaFei0JeN1L"
    "TdpRwGWIzGTWC2VpFhBZG1cUB3lJLzD4iajbnJ3i2/IVb3HELG2co+u611+ExrFejr5e50KkT14cc4lLfdwqbeZ5"
    "XET3SRwmueeXeaiQDQvfImK7anVBbkKHrCL7mKxuul/Qg1nG49CLAoXgtJtBHzZgk5nPCNuwA0PY02Z09icPDv6L"
    "g8MlHNVTt2q9v7C7MU53F2r8DZDZlY8="
)
"""{1: {"pose": (2, 3) float32 0-5, "frame_ids": [4, 5]}} as joblib 1.6 wrote it (BSD licence; the
bytes are this dictionary's), without and with compress=3."""


def read(folder: Path, data: bytes) -> Any:
    path = folder / "some.pkl"
    path.write_bytes(data)
    return load_plain(path)


def of_letters(array: np.ndarray) -> bool:
    """Whether texts have no half of a letter, which readers refuse."""
    letters = "".join(array.ravel().tolist()) if array.dtype.kind == "U" else ""
    return not any("\ud800" <= letter < "\ue000" for letter in letters)


@given(
    array=hnp.arrays(
        DTYPES, hnp.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4)
    ).filter(of_letters),
    fortran=st.booleans(),
    protocol=st.integers(2, 5),
    aligned=st.booleans(),
)
def test_arrays_come_back_as_they_were(array, fortran, protocol, aligned, tmp_path_factory):
    written = np.asarray(array, order="F" if fortran else "C")
    data = joblib_bytes([written, "between", {"again": written}], protocol, aligned=aligned)
    first, between, last = read(tmp_path_factory.getbasetemp(), data)
    assert between == "between"
    for found in (first, last["again"]):
        assert (found.shape, found.dtype) == (array.shape, array.dtype)
        assert found.tobytes() == array.tobytes()
        assert found.flags.writeable


@pytest.mark.parametrize("packer", sorted(PACKERS))
def test_compressed_files_are_told_by_their_first_bytes(packer, tmp_path):
    value = {3: {"pose": np.arange(144.0).reshape(2, 72), "frame_ids": np.arange(2)}}
    found = read(tmp_path, PACKERS[packer](joblib_bytes(value)))
    assert np.array_equal(found[3]["pose"], value[3]["pose"])
    assert np.array_equal(found[3]["frame_ids"], [0, 1])


@pytest.mark.parametrize("packer", sorted(PACKERS))
def test_every_truncation_is_an_error(packer, tmp_path):
    data = PACKERS[packer](joblib_bytes({"a": np.arange(3.0), "b": [1, "x"]}))
    for length in range(len(data)):
        with pytest.raises((BrokenPickle, UnsafePickle), match=r"some\.pkl"):
            read(tmp_path, data[:length])


@pytest.mark.parametrize("written", [BY_JOBLIB, BY_JOBLIB_PACKED])
def test_files_that_joblib_itself_wrote(written, tmp_path):
    found = read(tmp_path, b64decode(written))
    assert list(found) == [1]
    assert found[1]["pose"].dtype == np.float32
    assert found[1]["pose"].tolist() == [[0, 1, 2], [3, 4, 5]]
    assert found[1]["frame_ids"].tolist() == [4, 5]
    assert joblib_bytes(found) == b64decode(BY_JOBLIB)


def test_a_default_dict_with_numpys_integers_as_keys(tmp_path):
    """As WHAM has it."""
    people: defaultdict[Any, dict[str, Any]] = defaultdict(dict)
    people[np.int64(7)]["betas"] = np.ones((2, 10), np.float32)
    found = read(tmp_path, joblib_bytes(people))
    assert type(found) is dict
    assert list(found) == [7]
    assert np.array_equal(found[7]["betas"], np.ones((2, 10)))


def test_an_entry_that_two_places_share_stays_shared(tmp_path):
    """As PHALP has the pose of a track that is not seen."""
    smpl = {"body_pose": np.zeros((23, 3, 3))}
    found = read(tmp_path, joblib_bytes([[smpl], [smpl]]))
    assert found[0][0] is found[1][0]


@pytest.mark.parametrize("protocol", range(2, 6))
def test_a_call_is_refused_and_not_run(protocol, tmp_path):
    touched = tmp_path / "touched"
    call = Calls(exec, f"open({str(touched)!r}, 'w')")
    hidden = np.array([call, 1], dtype=object)
    for value in (call, {"a": np.ones(2), "b": call}, [hidden]):
        for data in (joblib_bytes(value, protocol), zlib.compress(joblib_bytes(value, protocol))):
            with pytest.raises(UnsafePickle, match=r"some\.pkl"):
                read(tmp_path, data)
    assert not touched.exists()


WRAPPER = b"cjoblib.numpy_pickle\nNumpyArrayWrapper\n"
F8 = b"cnumpy\ndtype\n(S'f8'\nI0\nI1\ntR"


def wrapper(subclass: bytes, shape: bytes, dtype: bytes = F8) -> bytes:
    """A wrapper whose state is spelt out, at the end of a stream of protocol 2."""
    state = b"(dS'subclass'\n" + subclass + b"sS'shape'\n" + shape + b"sS'order'\nS'C'\ns"
    return b"\x80\x02" + WRAPPER + b")\x81" + state + b"S'dtype'\n" + dtype + b"sb"


@pytest.mark.parametrize(
    ("data", "error"),
    [
        (wrapper(b"cos\nsystem\n", b"(I1\nt") + bytes(8) + b".", UnsafePickle),
        (wrapper(b"cnumpy\ndtype\n", b"(I1\nt") + bytes(8) + b".", UnsafePickle),
        (wrapper(b"S'numpy.ndarray'\n", b"(I1\nt") + bytes(8) + b".", UnsafePickle),
        (
            wrapper(b"cnumpy\nndarray\n", b"(I1\nt", b"cnumpy\ndtype\n(S'O8'\nI0\nI1\ntR")
            + pickle.dumps(np.array([1], dtype=object), 2)
            + b".",
            UnsafePickle,
        ),
        (wrapper(b"cnumpy\nndarray\n", b"(I-1\nt") + bytes(8) + b".", BrokenPickle),
        (wrapper(b"cnumpy\nndarray\n", b"(L4611686018427387904L\nt") + b"abc.", BrokenPickle),
        (wrapper(b"cnumpy\nndarray\n", b"S'x'\n") + bytes(8) + b".", BrokenPickle),
        (b"\x80\x02" + WRAPPER + b")\x81.", BrokenPickle),
        (b"\x80\x02" + WRAPPER + b")\x81]b.", BrokenPickle),
        (b"\x80\x02" + WRAPPER + b"(I1\nt\x81.", UnsafePickle),
        (b"\x80\x02ccollections\ndefaultdict\n(cos\nsystem\ntR.", UnsafePickle),
        (b"\x80\x02ccollections\ndefaultdict\n(c__builtin__\ndict\n(dtR.", UnsafePickle),
        (b"\x80\x02c__builtin__\ndict\n)R.", UnsafePickle),
    ],
)
def test_a_misused_wrapper_is_refused(data, error, tmp_path):
    with pytest.raises(error, match=r"some\.pkl"):
        read(tmp_path, data)


def test_the_spelt_out_wrapper_itself_is_read(tmp_path):
    """So that the refusals above are of what is wrong in each."""
    data = wrapper(b"cnumpy\nndarray\n", b"(I2\nt") + np.array([1.5, -2.0]).tobytes() + b"."
    assert read(tmp_path, data).tolist() == [1.5, -2.0]


@pytest.mark.parametrize("packer", ["zlib", "gzip", "bz2", "xz"])
def test_a_file_that_unpacks_without_end_is_refused(packer, tmp_path, monkeypatch):
    monkeypatch.setattr(limits, "FREE_BYTES", 3 << 20)
    with pytest.raises(BrokenPickle, match=r"some\.pkl: unpacks to more bytes than"):
        read(tmp_path, PACKERS[packer](bytes(5 << 20)))
