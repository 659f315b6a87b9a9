"""What tests of several readers share."""

import pickle  # noqa: TID251  The tests change what is in a sequence file.
from typing import Any

import pytest

from gmrdata.write.threedpw import sequence_bytes


@pytest.fixture
def content(walk_arrays, tmp_path) -> dict[str, Any]:
    """The dictionary of a good sequence file of 3DPW."""
    (tmp_path / "good.pkl").write_bytes(sequence_bytes(walk_arrays))
    return dict(pickle.loads((tmp_path / "good.pkl").read_bytes(), encoding="latin1"))
