"""numpy's files of one object, with torch's tensors in it: read without running anything."""

import pickle  # noqa: TID251  Writes what must be refused.
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from gmrdata.read.safe_pickle import load_object_npy, load_plain
from gmrdata.values.errors import BrokenPickle, UnsafePickle
from tests.damage import bytes_changed, in_one_folder, read_or_refused


@pytest.fixture(scope="module")
def track_of_tram(tmp_path_factory) -> bytes:
    """Written once: torch names a storage by its address, so a second file may be longer."""
    path = tmp_path_factory.mktemp("tram") / "hps_track_0.npy"
    tensors = {"pred_rotmat": torch.eye(3).repeat(2, 24, 1, 1), "frame": torch.arange(2)}
    np.save(path, tensors)  # type: ignore[arg-type]
    return path.read_bytes()


@given(data=st.data())
@in_one_folder(60)
def test_a_damaged_file_of_tram_is_an_error_or_reads_as_it_was(data, tmp_path, track_of_tram):
    """Nothing of what it holds is run, and no number of its tensors is read beyond its bytes."""
    path = tmp_path / "hps_track_0.npy"
    cut = track_of_tram[: data.draw(st.integers(0, len(track_of_tram) - 1))]
    for damaged in (cut, bytes_changed(data, track_of_tram, 1)):
        found = read_or_refused(path, damaged, load_object_npy)
        assert found is None or isinstance(found, dict)


def test_tensors_of_any_step_and_type_are_arrays(tmp_path):
    path = tmp_path / "x.npy"
    whole = torch.arange(24.0).reshape(2, 3, 4)
    tensors = {
        "part": whole[1:, ::2],
        "turned": whole.transpose(0, 2),
        "none": whole[:0],
        "one": torch.tensor(5, dtype=torch.int16),
        "half": whole.half(),
        "bool": whole > 3,
        "array": np.arange(3),
    }
    np.save(path, tensors)  # type: ignore[arg-type]
    for found in (load_object_npy(path), load_plain(_pickled(tmp_path / "x.pkl", tensors))):
        for key, value in tensors.items():
            expected = np.asarray(value)
            assert found[key].dtype == expected.dtype
            np.testing.assert_array_equal(found[key], expected)
    np.save(path, {"bfloat16": whole.bfloat16()})  # type: ignore[arg-type]
    found = load_object_npy(path)["bfloat16"]  # numpy has no such type
    np.testing.assert_array_equal(found, np.asarray(whole.bfloat16().float()))
    np.save(path, {"sparse": whole.to_sparse()})  # type: ignore[arg-type]
    with pytest.raises(UnsafePickle, match="_rebuild_sparse_tensor"):
        load_object_npy(path)
    np.save(path, {"far": torch.zeros(1).expand(1 << 40)})  # type: ignore[arg-type]
    with pytest.raises(BrokenPickle, match="numbers"):
        load_object_npy(path)


def _pickled(path: Path, value: object) -> Path:
    path.write_bytes(pickle.dumps(value))
    return path
