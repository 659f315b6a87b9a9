"""A small file can't fill the memory, stall or crash the reader: each asks for more than it may."""

import io
import lzma
import pickle  # noqa: TID251  The tests write the pickles that are to be read.
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from scipy import sparse

from gmrdata.motion.gait import embedded_motions
from gmrdata.read.safe_pickle import load_plain
from gmrdata.read.systems.result import read_system
from gmrdata.read.torch_files import load_tensors
from gmrdata.values import limits
from gmrdata.values.camera import CameraPath
from gmrdata.values.errors import BadMotionFile, BrokenPickle, GmrdataError, UnsafePickle
from gmrdata.values.files import read_npz
from gmrdata.values.limits import MIB, Budget
from tests.joblib_layout import joblib_bytes
from tests.read.system_files import some_wham, write_joblib, write_prompthmr


def test_what_a_file_may_ask_for_grows_with_it_up_to_a_ceiling():
    small, large, huge = (Budget.of_size(size) for size in (1, 20 * MIB, 4096 * MIB))
    assert small.bytes_left == 256 * MIB and small.numbers_left == 32 * MIB
    assert large.bytes_left == 64 * 20 * MIB and large.numbers_left == 8 * 20 * MIB
    assert huge.bytes_left == 4096 * MIB and huge.numbers_left == 512 * MIB
    assert (small.nodes_left, large.nodes_left, huge.nodes_left) == (2e6, 20e6, 20e6)


def _zeros(path: Path) -> None:
    """As `np.savez_compressed` of 300 MiB of zeros, without making them."""
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        header, {"descr": "|i1", "fortran_order": False, "shape": (300 * MIB,)}
    )
    archive = zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1)
    with archive, archive.open("poses.npy", "w", force_zip64=True) as stream:
        stream.write(header.getvalue())
        for _ in range(300):
            stream.write(bytes(MIB))


def _many_members(path: Path) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        for number in range(limits.MOST_MEMBERS + 1):
            archive.writestr(f"{number}.npy", b"")


def _small_numbers(path: Path) -> None:
    """40 MiB of bytes, which as float64 are 320 MiB."""
    np.savez_compressed(path, poses=np.zeros(40 * MIB, np.int8))


@pytest.mark.parametrize(
    ("write", "said"),
    [
        (_zeros, "unpacks to more bytes than a file of [0-9]+ bytes has any use for"),
        (_many_members, "holds 10001 files"),
        (_small_numbers, "holds more numbers"),
    ],
)
def test_npz_beyond_the_budget(write, said, tmp_path):
    path = tmp_path / "a.npz"
    write(path)
    with pytest.raises(BadMotionFile, match=rf"a\.npz: {said}"):
        read_npz(path)


def test_a_file_that_is_as_large_as_any_may_be_is_not_called_broken(tmp_path, monkeypatch):
    """Of a long video PHALP's file takes too many steps, and another copy of it is no help."""
    steps = HEAD + b"N0" * 9000 + b"N" + END
    (tmp_path / "some.pkl").write_bytes(steps)
    monkeypatch.setattr(limits, "FREE_NODES", 100)
    monkeypatch.setattr(limits, "MOST_NODES", len(steps) - 2)
    said = (
        r"pkl: takes more steps to read than any file may \(docs/security\.md\); cut it into parts"
    )
    with pytest.raises(BrokenPickle, match=said):
        load_plain(tmp_path / "some.pkl")
    (tmp_path / "some.pkl").write_bytes(zlib.compress(steps))
    with pytest.raises(BrokenPickle, match="bytes has any use for; get it from its maker"):
        load_plain(tmp_path / "some.pkl")


def test_our_own_masks_may_be_small_beside_what_they_hold(tmp_path):
    _small_numbers(tmp_path / "a.npz")
    assert read_npz(tmp_path / "a.npz", Budget.ceiling())["poses"].size == 40 * MIB


def laughs(part: Any, times: int = 9) -> Any:
    """Ten of ten of ten of ...: a few bytes that stand for ten billion."""
    for _ in range(times):
        part = [part] * 10
    return part


def _in_object_array(part: Any) -> np.ndarray:
    array = np.empty(1, dtype=object)
    array[0] = part
    return array


class _Chumpy:
    """Pickles as chumpy's arrays do."""

    def __init__(self, x: Any) -> None:
        self.x = x


def _chumpy(x: Any) -> bytes:
    _Chumpy.__module__, _Chumpy.__qualname__ = "tests.read.test_budget", "_Chumpy"
    data = pickle.dumps(_Chumpy(x), protocol=2)
    return data.replace(b"tests.read.test_budget\n_Chumpy\n", b"chumpy.ch\nCh\n")


def _in_itself() -> list[Any]:
    found: list[Any] = []
    found.append(found)
    return found


def _keys(numbers: list[int]) -> bytes:
    parts = b"".join(b"\x8a\x0a" + n.to_bytes(10, "little", signed=True) + b"N" for n in numbers)
    return b"\x80\x04}(" + parts + b"u."


MERSENNE = 2**61 - 1  # whose multiples all have the hash 0
HEAD, END = b"\x80\x04", b"."
PICKLES: dict[str, tuple[bytes, str]] = {
    "laughs": (pickle.dumps(laughs(1.0)), "holds more numbers"),
    "laughs in tuples": (pickle.dumps((laughs(1.0, 8),) * 40), "holds more numbers"),
    "laughs in an array": (pickle.dumps(_in_object_array(laughs(1.0))), "holds more numbers"),
    "laughs in chumpy": (_chumpy(laughs(1.0)), "holds more numbers"),
    "a long text among many": (pickle.dumps(["x" * 10**5, *"abc" * 10**4]), "holds more numbers"),
    "one array often": (pickle.dumps([np.zeros(10**5)] * 10**4), "holds more numbers"),
    "a list in itself": (pickle.dumps(_in_itself()), "is in itself"),
    "sparse": (pickle.dumps(sparse.csc_matrix((30_000, 30_000))), "holds more numbers"),
    "no bytes": (pickle.dumps(np.zeros(9, "V1")).replace(b"V1", b"S0"), "truncated|wants"),
    "steps": (zlib.compress(HEAD + b"N0" * 1_010_000 + b"N" + END), "takes more steps"),
    "a deep key": (HEAD + b"}N" + b"\x85" * 60_000 + b"Ns" + END, "has a key of 32 parts"),
    "a key of shared tuples": (HEAD + b"}N" + b"2\x86" * 60 + b"Ns" + END, "has a key of 32 parts"),
    "a deep member": (HEAD + b"\x8f(N" + b"\x85" * 60_000 + b"\x90" + END, "has a key of 32"),
    "a deep frozen member": (HEAD + b"(N" + b"\x85" * 60_000 + b"\x91" + END, "has a key of 32"),
    "keys of one hash": (_keys([-n * MERSENNE for n in range(1, 20_002)]), "more than 20000 keys"),
    "odd keys": (pickle.dumps({(n,): n for n in range(20_001)}), "more than 20000 keys"),
    "a memo of one hash": (b"N" + b"p%d\n" % (7 * MERSENNE) + END, "under a number"),
    "a huge name": (HEAD + b"(" + b"N" + b"\x85" * 60_000 + b"Q.", "outside object|truncated"),
}


@pytest.mark.parametrize("name", sorted(PICKLES))
def test_pickles_beyond_the_budget(name, tmp_path):
    data, said = PICKLES[name]
    path = tmp_path / "some.pkl"
    path.write_bytes(data)
    with pytest.raises((BrokenPickle, UnsafePickle), match=rf"some\.pkl: .*({said})"):
        load_plain(path)


def test_compressed_files_that_ask_for_memory_or_end_early(tmp_path):
    path = tmp_path / "some.pkl"
    whole = lzma.compress(pickle.dumps([1, 2]), format=lzma.FORMAT_ALONE)
    path.write_bytes(whole)
    assert load_plain(path) == [1, 2]
    path.write_bytes(whole[:-3])
    with pytest.raises(BrokenPickle, match=r"some\.pkl: truncated"):
        load_plain(path)
    path.write_bytes(whole[:1] + struct.pack("<I", 0x80000000) + whole[5:])
    with pytest.raises(BrokenPickle, match="Memory usage limit"):
        load_plain(path)


@pytest.mark.parametrize("dump", [joblib_bytes, pickle.dumps])
def test_meshes_of_people_are_neither_made_nor_counted(dump, tmp_path, monkeypatch):
    """WHAM's and VIBE's own files have 6890 vertices a row: 27,000 rows were too many numbers."""
    monkeypatch.setattr(limits, "MOST_NUMBERS", 10_000)
    people = dict(some_wham({0: 4, 1: 3}))
    for one in people.values():
        one["verts"] = np.zeros((len(one["frame_ids"]), 6890, 3), np.float32)
    path = tmp_path / "wham_output.pkl"
    path.write_bytes(dump(people))
    with pytest.raises(BrokenPickle, match=r"wham_output\.pkl: holds more numbers"):
        load_plain(path)
    assert [len(one.frame_numbers) for one in read_system(path, "world").people] == [4, 3]
    found = load_plain(path, without=frozenset({"verts"}))
    assert found[1].keys() == people[1].keys() - {"verts"}
    np.testing.assert_array_equal(found[1]["pose"], people[1]["pose"])
    path.write_bytes(path.read_bytes()[:-9])
    with pytest.raises(BrokenPickle, match=r"wham_output\.pkl: truncated"):
        read_system(path)


def test_masks_of_prompthmr_are_neither_made_nor_counted(tmp_path, small_body, monkeypatch):
    """Its whole result has them, of all and of each person: 189 frames were too many numbers."""
    (motion,) = embedded_motions(
        small_body, np.random.default_rng(0), count=1, fps_hz=10.0, duration_s=1.0
    )
    n, matrix_px = motion.n_frames, np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]])
    camera = CameraPath(matrix_px, 640, 480, np.tile(np.eye(4), (n, 1, 1)), np.ones(n, bool))
    path = write_prompthmr(tmp_path / "results.pkl", motion, camera, np.arange(n))
    whole, masks = load_plain(path), np.zeros((n, 48, 64), bool)
    whole["people"][1] |= {"masks": masks, "prhmr_img_feats": np.zeros((n, 4096), np.float32)}
    write_joblib(path, whole | {"masks": masks})
    monkeypatch.setattr(limits, "MOST_NUMBERS", 20_000)
    with pytest.raises(BrokenPickle, match=r"results\.pkl: holds more numbers"):
        load_plain(path)
    (person,) = read_system(path, "camera").people
    np.testing.assert_allclose(person.local_rotmats[:, :21], motion.local_rotmats[:, :21])


def test_what_is_shared_and_small_is_read(tmp_path):
    path = tmp_path / "some.pkl"
    array = np.arange(1000.0)
    keys = {(1, "a"): 1, 2**59: 2, 0.5: 3, None: 4, b"x": 5, True: 6}
    value = [laughs(1.0, 3), [array] * 3, {1, 2}, frozenset("ab"), keys]
    path.write_bytes(pickle.dumps(value))
    found = load_plain(path)
    assert found[0] == laughs(1.0, 3) and found[2:] == [{1, 2}, frozenset("ab"), keys]
    assert found[1][0] is found[1][2] and np.array_equal(found[1][0], array)


def saved(path: Path, value: Any) -> Path:
    torch.save({"body_pose": value}, path)
    return path


def test_tensors_are_what_torch_reads(tmp_path):
    torch.manual_seed(0)
    tensors = {
        "plain": torch.randn(4, 3),
        "turned": torch.randn(4, 3).T,
        "a part": torch.randn(9)[2:7],
        "stepped": torch.arange(20)[::3],
        "repeated": torch.randn(1, 3).expand(50, 3),
        "one": torch.tensor(3),
        "none": torch.zeros(0, 5),
        "bool": torch.tensor([True, False]),
        "half": torch.randn(3).half(),
        "bfloat16": torch.randn(5).bfloat16(),
        "parameter": torch.nn.Parameter(torch.randn(2)),
    }
    torch.save({"in": [tensors, (1, "a", None)], "size": torch.Size([2, 3])}, tmp_path / "a.pt")
    found = load_tensors(tmp_path / "a.pt")
    assert found["size"] == (2, 3) and found["in"][1] == (1, "a", None)
    for name, tensor in tensors.items():
        assert np.array_equal(found["in"][0][name], tensor.detach().to(torch.float64).numpy())
        assert found["in"][0][name].shape == tensor.shape


ODD_TENSORS: dict[str, Callable[[], Any]] = {
    "repeated": lambda: torch.zeros(1).expand(30_000_000, 63),
    "meta": lambda: torch.zeros(9, 63, device="meta"),
    "sparse": lambda: torch.zeros(9, 63).to_sparse(),
    "quantized": lambda: torch.quantize_per_tensor(torch.zeros(9), 0.1, 0, torch.qint8),
    "nested": lambda: torch.nested.nested_tensor([torch.zeros(9, 63)]),
    "often": lambda: [torch.zeros(10**5)] * 10**4,
    "code": lambda: np.polyfit,
}


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("kind", sorted(ODD_TENSORS))
def test_tensors_beyond_the_budget_and_of_other_kinds(kind, tmp_path):
    path = saved(tmp_path / "some.pt", ODD_TENSORS[kind]())
    said = "holds more numbers" if kind in ("repeated", "often") else "wants to (import|call) "
    with pytest.raises(GmrdataError, match=rf"some\.pt: {said}"):
        load_tensors(path)


@pytest.mark.parametrize(
    ("files", "said"),
    [
        ({"a/data.pkl": PICKLES["a deep key"][0]}, "has a key of 32 parts"),
        ({"a/data.pkl": b"N.", "b/data.pkl": b"N."}, "it has 2 files"),
        ({"a/data.pkl": b"N.", "A/DATA.PKL": b"N."}, "or two of one name"),
        ({"a/data.pkl": b"N.", "a/byteorder": b"big"}, "byte order"),
        ({"a/other": b"N."}, "it has 0 files"),
        ({"a/data.pkl": b"N."}, "holds no dict"),
        ({"a/data.pkl": b"}X\1\0\0\0a"}, "EOFError"),
    ],
)
def test_archives_that_torch_does_not_write(files, said, tmp_path):
    with zipfile.ZipFile(tmp_path / "some.pt", "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    with pytest.raises(BadMotionFile, match=rf"some\.pt: .*{said}"):
        load_tensors(tmp_path / "some.pt")


def test_an_array_whose_header_is_no_text_of_python(tmp_path):
    np.savez(tmp_path / "a.npz", poses=np.zeros(3))
    data = (tmp_path / "a.npz").read_bytes()
    with zipfile.ZipFile(tmp_path / "b.npz", "w") as archive:
        content = zipfile.ZipFile(io.BytesIO(data)).read("poses.npy")
        archive.writestr("poses.npy", content.replace(b"(3,), }", b"((((\0\n "))
    with pytest.raises(BadMotionFile, match=r"b\.npz: not a readable \.npz"):
        read_npz(tmp_path / "b.npz")


def test_a_file_in_an_archive_that_is_no_array(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("poses.npy", b"no array")
    with pytest.raises(BadMotionFile, match=r"a\.npz: not a readable \.npz .*'poses' is no array"):
        read_npz(tmp_path / "a.npz")
