"""Reading pickles of plain data, and refusing all others without running them."""

import pickle  # noqa: TID251  The tests write the pickles that are to be read.
import struct
from collections import OrderedDict, defaultdict
from contextlib import suppress
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy import sparse

from gmrdata.read.safe_pickle import load_plain
from gmrdata.values.errors import BrokenPickle, MissingInput, UnsafePickle
from tests.damage import Calls, bytes_changed

PROTOCOLS = range(pickle.HIGHEST_PROTOCOL + 1)
DTYPES = st.sampled_from(["<f8", ">f4", "<i4", ">u2", "|u1", "?", "<c16", "|S3", "<U2", "<f2"])


def read(folder: Path, data: bytes) -> Any:
    path = folder / "some.pkl"
    path.write_bytes(data)
    return load_plain(path)


def named(module: str, name: str) -> bytes:
    return f"c{module}\n{name}\n".encode()


@given(
    array=hnp.arrays(DTYPES, hnp.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4)),
    fortran=st.booleans(),
    protocol=st.sampled_from(PROTOCOLS),
)
def test_numpy_arrays_come_back_as_they_were(array, fortran, protocol, tmp_path_factory):
    written = np.asarray(array, order="F" if fortran else "C")
    found = read(tmp_path_factory.getbasetemp(), pickle.dumps(written, protocol))
    assert (found.shape, found.dtype, found.tobytes()) == (
        array.shape,
        array.dtype,
        array.tobytes(),
    )
    assert found.flags.writeable


scalars = (
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text() | st.binary()
)
nested = st.recursive(
    scalars,
    lambda inner: (
        st.lists(inner)
        | st.lists(inner).map(tuple)
        | st.dictionaries(st.text() | st.integers(), inner)
        | st.sets(st.integers())
    ),
    max_leaves=12,
)


@given(value=nested, protocol=st.sampled_from(PROTOCOLS))
def test_containers_come_back_as_they_were(value, protocol, tmp_path_factory):
    found = read(tmp_path_factory.getbasetemp(), pickle.dumps(value, protocol))
    assert found == value
    assert repr(type(found)) == repr(type(value))


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_scalars_object_arrays_and_sparse_matrices(tmp_path, protocol):
    objects = np.array([[1, "x", None], [np.ones(2), {"a": b"z"}, (3,)]], dtype=object)
    value = {
        "scalar": np.float32(2.5),
        "objects": np.asfortranarray(objects),
        "csc": sparse.csc_matrix(np.diag([1.0, 0.0, 3.0])),
        "csr": sparse.csr_matrix(np.array([[0, 2], [5, 0]])),
    }
    found = read(tmp_path, pickle.dumps(value, protocol))
    assert found["scalar"] == np.float32(2.5)
    assert found["scalar"].dtype == np.float32
    assert found["objects"].shape == (2, 3)
    assert found["objects"][0].tolist() == [1, "x", None]
    assert found["objects"][1, 1] == {"a": b"z"}
    assert np.array_equal(found["objects"][1, 0], np.ones(2))
    assert np.array_equal(found["csc"].toarray(), np.diag([1.0, 0.0, 3.0]))
    assert np.array_equal(found["csr"].toarray(), [[0, 2], [5, 0]])


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_an_ordered_dict_is_a_dict(tmp_path, protocol):
    value = OrderedDict(b=OrderedDict(), a=1)
    assert list(read(tmp_path, pickle.dumps(value, protocol)).items()) == [("b", {}), ("a", 1)]
    python_2 = named("collections", "OrderedDict") + b"((l(lS'b'\naI1\naa(lS'a'\naI2\naatR."
    assert list(read(tmp_path, python_2).items()) == [("b", 1), ("a", 2)]


@pytest.mark.parametrize("protocol", PROTOCOLS)
@pytest.mark.parametrize("factory", [None, dict, list, set, int, float, str, defaultdict])
def test_a_default_dict_of_any_plain_kind_is_a_dict(factory, protocol, tmp_path):
    table = defaultdict(factory, {"walk": [np.ones(2)]})
    found = read(tmp_path, pickle.dumps(table, protocol=protocol))
    assert type(found) is dict
    assert found["walk"][0].tolist() == [1, 1]


@pytest.mark.parametrize("protocol", PROTOCOLS)
@pytest.mark.parametrize("path", [PurePosixPath("/a/b.jpg"), PureWindowsPath("c:/a/b.jpg"), Path()])
def test_a_path_is_its_text(path, protocol, tmp_path):
    found = read(tmp_path, pickle.dumps([path], protocol=protocol))
    assert [type(path)(text) for text in found] == [path]


def test_paths_that_one_long_text_makes_count_each_time(tmp_path):
    """Joining would make a new text for each of them."""
    join = b"cpathlib\nPosixPath\n(h\x00h\x00tR"
    data = b"\x80\x02]X" + struct.pack("<I", 1 << 20) + b"a" * (1 << 20) + b"q\x000" + b"("
    with pytest.raises(BrokenPickle, match="unpacks to"):
        read(tmp_path, data + join * 100_000 + b"e.")


def test_python_2_text_pickle_with_binary_array(tmp_path):
    """Protocol 0 of Python 2: raw bytes as an escaped string, `copy_reg`, and numpy's old names."""
    data = (
        b"(dp0\nS'poses'\np1\ncnumpy.core.multiarray\n_reconstruct\np2\n(cnumpy\nndarray\np3\n"
        b"(I0\ntp4\nS'b'\np5\ntp6\nRp7\n(I1\n(I2\ntp8\ncnumpy\ndtype\np9\n(S'f8'\np10\nI0\nI1\ntp11\n"
        b"Rp12\n(I3\nS'<'\np13\nNNNI-1\nI-1\nI0\ntp14\nbI00\n"
        b"S'\\x00\\x00\\x00\\x00\\x00\\x00\\xf8?\\x00\\x00\\x00\\x00\\x00\\x00\\x04\\xc0'\np15\ntp16\nb"
        b"sS'name'\np17\nS'caf\\xe9'\np18\ns."
    )
    found = read(tmp_path, data)
    assert found["poses"].tolist() == [1.5, -2.5]
    assert found["name"] == "café"


CHUMPY_STATE = {"_dirty_vars": set(), "_itr": None, "_status": "new"}


class Ch:
    """Stands for chumpy's class of the same name, whose instances pickle as their `__dict__`."""


class Select(Ch):
    """Stands for chumpy's node for indexing."""


def chumpy_pickle(value: object, protocol: int) -> bytes:
    """A pickle whose `Ch` and `Select` are chumpy's; below protocol 4 modules stand in text."""
    data = pickle.dumps(value, protocol)
    here = Ch.__module__.encode()
    for name, module in ((b"Ch", b"chumpy.ch"), (b"Select", b"chumpy.reordering")):
        data = data.replace(b"c" + here + b"\n" + name, b"c" + module + b"\n" + name)
    return data


@pytest.mark.parametrize("protocol", range(4))
def test_chumpy_arrays_become_numpy_arrays(tmp_path, protocol):
    array = np.arange(12.0).reshape(2, 3, 2)
    leaf, chosen = Ch(), Select()
    leaf.__dict__ |= CHUMPY_STATE | {"x": array}
    idxs = np.arange(12).reshape(2, 3, 2)[:, :, :1].ravel()
    chosen.__dict__ |= CHUMPY_STATE | {"a": leaf, "idxs": idxs, "preferred_shape": (2, 3, 1)}
    found = read(tmp_path, chumpy_pickle({"leaf": leaf, "dirs": chosen}, protocol))
    assert np.array_equal(found["leaf"], array)
    assert np.array_equal(found["dirs"], array[:, :, :1])


TOUCH = "touched"
HOSTILE = {
    "os.system": named("os", "system") + b"(S'touch touched'\ntR.",
    "posix.system": named("posix", "system") + b"(S'touch touched'\ntR.",
    "nt.system": named("nt", "system") + b"(S'touch touched'\ntR.",
    "builtins.eval": named("builtins", "eval") + b'(S\'open("touched", "w")\'\ntR.',
    "__builtin__.eval": named("__builtin__", "eval") + b'(S\'open("touched", "w")\'\ntR.',
    "builtins.exec": b"\x80\x04\x8c\x08builtins\x8c\x04exec\x93\x8c\x04pass\x85R.",
    "builtins.getattr": named("builtins", "getattr") + b"(cnumpy\nndarray\nS'tofile'\ntR.",
    "builtins.open": named("builtins", "open") + b"(S'touched'\nS'w'\ntR.",
    "subprocess.Popen": named("subprocess", "Popen") + b"((S'touch'\nS'touched'\nltR.",
    "numpy.fromfile": named("numpy", "fromfile") + b"(S'/etc/passwd'\ntR.",
    "numpy.load": named("numpy", "load") + b"(S'x.npy'\ntR.",
    "numpy.memmap": named("numpy", "memmap") + b"(S'touched'\nS'u1'\nS'w+'\nI0\n(I1\nttR.",
    "numpy.testing._private.utils.runstring": named("numpy.testing._private.utils", "runstring")
    + b"(S'1'\n(dtR.",
    "numpy.core.multiarray.fromfile": named("numpy.core.multiarray", "fromfile") + b"(S'x'\ntR.",
    "codecs.open": named("codecs", "open") + b"(S'touched'\nS'w'\ntR.",
    "_codecs.decode": named("_codecs", "decode") + b"(S'x'\nS'rot13'\ntR.",
    "operator.attrgetter": named("operator", "attrgetter") + b"(S'__globals__'\ntR.",
    "functools.partial": named("functools", "partial") + b"(cos\nsystem\nS'touch touched'\ntR.",
    "copyreg.add_extension": named("copyreg", "add_extension") + b"(S'os'\nS'system'\nI7\ntR.",
    "pickle.loads": named("pickle", "loads") + b"(S'.'\ntR.",
    "torch.load": named("torch", "load") + b"(S'x'\ntR.",
    "scipy.sparse.csc.np.load": named("scipy.sparse.csc", "np.load") + b"(S'x'\ntR.",
    "numpy.ndarray.tofile": b"\x80\x04\x8c\x05numpy\x8c\x0endarray.tofile\x93.",
    "os.path.join": b"(S'a'\nios.path\njoin\n.",
    "chumpy.ch_ops.add": named("chumpy.ch_ops", "add") + b")\x81.",
    "collections.Counter": named("collections", "Counter") + b"(tR.",
    "collections.OrderedDict": named("collections", "OrderedDict") + b"(S'abc'\ntR.",
    "gmrdata.read.safe_pickle.load_plain": named("gmrdata.read.safe_pickle", "load_plain")
    + b"(S'x'\ntR.",
}


@pytest.mark.parametrize("wanted", sorted(HOSTILE))
def test_hostile_import_is_named_and_not_run(wanted, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UnsafePickle) as caught:
        read(tmp_path, HOSTILE[wanted])
    assert f"{wanted!r}" in str(caught.value)
    assert "some.pkl" in str(caught.value)
    assert not (tmp_path / TOUCH).exists()


ARRAY = named("numpy.core.multiarray", "_reconstruct") + b"(cnumpy\nndarray\n(I0\ntS'b'\ntR"
DTYPE_O = named("numpy", "dtype") + b"(S'O8'\nI0\nI1\ntR"
DTYPE_F8 = named("numpy", "dtype") + b"(S'f8'\nI0\nI1\ntR"
MISUSED = {
    "scalar of objects": named("numpy.core.multiarray", "scalar")
    + b"("
    + DTYPE_O
    + b"S'\\x00\\x00\\x00\\x00\\x00\\x00\\x00\\x00'\ntR.",
    "scalar of a pickle": named("numpy.core.multiarray", "scalar") + b"(S'O'\nS'cos system'\ntR.",
    "reconstruct another class": named("numpy.core.multiarray", "_reconstruct")
    + b"(cnumpy\ndtype\n(I0\ntS'b'\ntR.",
    "structured dtype": named("numpy", "dtype") + b"(S'f8,O'\nI0\nI1\ntR.",
    "dtype with fields": DTYPE_F8 + b"(I3\nS'|'\nN(S'a'\nt(dS'a'\nI1\nsI8\nI1\nI0\ntb.",
    "build on an import": named("numpy", "dtype") + b"(dS'__call__'\nS'x'\nsb.",
    "build on a list": b"](dS'append'\nS'x'\nsb.",
    "build twice": ARRAY + b"(dS'a'\nI1\nsb(dS'a'\nI1\nsb.",
    "reduce a string": b"S'os.system'\n(S'touch touched'\ntR.",
    "reduce a result": DTYPE_F8 + b"(tR.",
    "reduce by memo": b"S'system'\np0\n0g0\n(S'touch touched'\ntR.",
    "newobj with keywords": b"\x80\x04" + named("numpy", "dtype") + b"(t}\x8c\x01aK\x01s\x92.",
    "newobj of a function": b"\x80\x04" + named("_codecs", "encode") + b")\x81.",
    "encode with a python codec": named("_codecs", "encode") + b"(S'x'\nS'rot13'\ntR.",
    "set of an import's name": named("__builtin__", "set") + b"(cnumpy\nndarray\ntR.",
    "object of an import": named("copy_reg", "_reconstructor")
    + b"(cnumpy\nndarray\nc__builtin__\nobject\nNtR.",
    "object with a state": named("copy_reg", "_reconstructor")
    + b"(cchumpy.ch\nCh\nc__builtin__\nobject\nS'x'\ntR.",
    "import as data": b"(d" + b"S'a'\n" + named("numpy", "ndarray") + b"s.",
    "extension registry": b"\x80\x02\x82\x07.",
    "extension registry, long": b"\x80\x02\x84\x07\x00\x00\x00.",
    "persistent id": b"Pfile\n.",
    "binary persistent id": b"S'file'\nQ.",
    "old class by mark": b"(" + named("numpy", "dtype") + b"o.",
    "outside buffer": b"\x80\x05\x97.",
    "old instance": b"(S'touch touched'\nios\nsystem\n.",
    "old object": b"(cos\nsystem\nS'touch touched'\no.",
    "global of numpy's namespace": b"cnumpy\nos.system\n(S'touch touched'\ntR.",
    "dotted global": b"\x80\x04\x8c\x05numpy\x8c\x17core._methods.os.fspath\x93\x8c\x01x\x85R.",
    "numpy f2py": b"cnumpy.f2py.diagnose\nrun_command\n(S'touch touched'\ntR.",
    "numpy exec_command": b"cnumpy.distutils.exec_command\nexec_command\n(S'x'\ntR.",
    "numpy loads": b"cnumpy.core.multiarray\n_pickle.loads\n(S'.'\ntR.",
    "fake numpy module": b"cnumpy.core.multiarray.os\nsystem\n(S'touch touched'\ntR.",
    "reconstruct of os": b"cnumpy.core.multiarray\n_reconstruct\n(cos\nsystem\n(I0\ntS'b'\ntR.",
    "copy_reg reconstructor": b"ccopy_reg\n_reconstructor\n"
    b"(csubprocess\nPopen\nc__builtin__\nobject\nNtR.",
    "copyreg reconstructor": b"ccopyreg\n_reconstructor\n"
    b"(cos\n_wrap_close\ncbuiltins\nobject\nNtR.",
    "copyreg newobj": b"ccopyreg\n__newobj__\n(csubprocess\nPopen\nS'x'\ntR.",
    "newobj": b"\x80\x02csubprocess\nPopen\n(S'touch touched'\nt\x81.",
    "newobj of a process": b"\x80\x04csubprocess\nPopen\n(S'x'\nt}\x8c\x05shell\x88s\x92.",
    "stack global": b"\x80\x04\x8c\x05posix\x8c\x06system\x93\x8c\x01x\x85R.",
    "getattr": b"c__builtin__\ngetattr\n(c__builtin__\n__import__\nS'__call__'\ntR.",
    "import": b"c__builtin__\n__import__\n(S'os'\ntR.",
    "apply": b"c__builtin__\napply\n(cos\nsystem\n(S'x'\nttR.",
    "dtype state": DTYPE_F8 + b"(I4\nS'<'\nNNNI-1\nI-1\nI0\n(dcos\nsystem\ntb.",
    "array state": ARRAY + b"(dS'__setstate__'\ncos\nsystem\nsb.",
    "lambda": b"ctypes\nFunctionType\n(N(dtR.",
    "marshal": b"cmarshal\nloads\n(S'x'\ntR.",
    "nested pickle": b"c_pickle\nloads\n(S'cos\\nsystem\\n.'\ntR.",
}


@pytest.mark.parametrize("misuse", sorted(MISUSED))
def test_known_tricks_are_refused(misuse, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UnsafePickle, match=r"some\.pkl"):
        read(tmp_path, MISUSED[misuse])
    assert sorted(path.name for path in tmp_path.iterdir()) == ["some.pkl"]


def test_object_array_cannot_carry_a_call(tmp_path):
    call = Calls(exec, f"open({str(tmp_path / TOUCH)!r}, 'w')")
    for protocol in PROTOCOLS:
        data = pickle.dumps(np.array([call, 1], dtype=object), protocol)
        with pytest.raises(UnsafePickle, match=r"__builtin__\.exec|builtins\.exec"):
            read(tmp_path, data)
    assert not (tmp_path / TOUCH).exists()


BROKEN = {
    "empty": b"",
    "text": b"hello\n",
    "pdf": b"%PDF-1.4\n",
    "nothing on the stack": b".",
    "truncated array": pickle.dumps(np.arange(100.0), 2)[:-300],
    "huge string": b"\x80\x04\x8d" + struct.pack("<Q", 1 << 62) + b"abc.",
    "huge bytes": b"\x80\x04\x8e" + struct.pack("<Q", 1 << 62) + b"abc.",
    "huge bytearray": b"\x80\x05\x96" + struct.pack("<Q", 1 << 62) + b"abc.",
    "huge frame": b"\x80\x04\x95" + struct.pack("<Q", 1 << 62) + b"K\x01",
    "huge number": b"\x80\x02\x8b" + struct.pack("<i", (1 << 31) - 1) + b"\x01",
    "negative length": b"\x80\x02\x8b" + struct.pack("<i", -1) + b"\x01.",
    "long decimal": b"L" + b"9" * 100_000 + b"L\n.",
    "protocol 9": b"\x80\x09N.",
    "pop of an empty stack": b"0.",
    "tuple without mark": b"t.",
    "unknown memo": b"g7\n.",
    "append to a number": b"I1\nI2\na.",
    "unhashable key": b"(d]S'x'\ns.",
    "deep nesting": b"(" * 100_000 + b"l" * 100_000 + b".",
    "deep tuples": b")" + b"\x85" * 100_000 + b".",
    "huge array": ARRAY + b"(I1\n(L4611686018427387904L\nt" + DTYPE_F8 + b"I00\nS'abc'\ntb.",
    "array of negative size": ARRAY + b"(I1\n(I-1\nt" + DTYPE_F8 + b"I00\nS''\ntb.",
    "array without its bytes": ARRAY + b"(I1\n(I2\nt" + DTYPE_F8 + b"I00\nS'abc'\ntb.",
    "array without a state": ARRAY + b".",
    "objects without a list": ARRAY + b"(I1\n(I1\nt" + DTYPE_O + b"I00\nS'abcdefgh'\ntb.",
}


@pytest.mark.parametrize("kind", sorted(BROKEN))
def test_broken_file_is_an_error_that_names_it(kind, tmp_path):
    with pytest.raises(BrokenPickle, match=r"some\.pkl: truncated or not a pickle"):
        read(tmp_path, BROKEN[kind])


def test_missing_file(tmp_path):
    with pytest.raises(MissingInput, match=r"none\.pkl"):
        load_plain(tmp_path / "none.pkl")


def test_sparse_index_outside_its_shape_is_refused(tmp_path):
    """scipy writes outside its memory when such a matrix is made dense."""
    matrix = sparse.csc_matrix(np.eye(3))
    matrix.indices = np.array([0, 1_000_000, 2], dtype=np.int32)
    with pytest.raises(BrokenPickle, match="indices"):
        read(tmp_path, pickle.dumps(matrix, 2))


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_every_truncation_is_an_error(tmp_path, protocol):
    data = pickle.dumps({"a": np.arange(3.0), "b": ["x", (1, 2.5)], "c": {4}}, protocol)
    for length in range(len(data)):
        with pytest.raises((BrokenPickle, UnsafePickle)):
            read(tmp_path, data[:length])


@given(data=st.data())
def test_changed_bytes_never_reach_anything_else(data, tmp_path_factory):
    """Whatever a few changed bytes make of a file, it is read as plain data or refused."""
    protocol = data.draw(st.sampled_from(PROTOCOLS))
    content = pickle.dumps({"a": np.arange(3.0), "b": [1, "x", (2.5, None)]}, protocol)
    with suppress(BrokenPickle, UnsafePickle):
        assert_plain(read(tmp_path_factory.getbasetemp(), bytes_changed(data, content)))


def assert_plain(value: Any) -> None:
    if isinstance(value, dict):
        for key, item in value.items():
            assert_plain(key)
            assert_plain(item)
    elif isinstance(value, list | tuple | set | frozenset):
        for item in value:
            assert_plain(item)
    else:
        plain_kinds = int | float | complex | str | bytes | bytearray | np.ndarray | np.generic
        assert value is None or isinstance(value, plain_kinds | np.dtype)


def test_shared_parts_stay_shared_and_do_not_multiply(tmp_path):
    value: list[Any] = [np.arange(3.0)]
    for _ in range(20):
        value = [value, value]
    found = read(tmp_path, pickle.dumps(value, 2))
    assert found[0] is found[1]


@pytest.mark.parametrize("protocol", [0, 1, 2, 4, 5])
def test_texts_that_no_file_or_page_can_hold(protocol, tmp_path):
    path = tmp_path / "a.pkl"
    letters = np.array([97, 0x110000], np.uint32).view("U2")
    for value, what in (({"a\ud800": 1}, "half of a surrogate"), (letters, "a text of no letters")):
        path.write_bytes(pickle.dumps(value, protocol))
        with pytest.raises(BrokenPickle, match=rf"a\.pkl: .*{what}"):
            load_plain(path)
    for whole in ("\U0001f600", "é" * 70_000):
        path.write_bytes(pickle.dumps([whole, np.array([whole])], protocol))
        text, array = load_plain(path)
        assert text == whole and array.tolist() == [whole]
