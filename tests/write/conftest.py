"""The take that most tests write."""

import pytest

from gmrdata.write.take import Take
from tests.write.takes import make_take


@pytest.fixture(scope="session")
def take(walk, small_body) -> Take:
    """Someone who walks, a second who is not always there, and a camera with a gap."""
    return make_take(walk, small_body)
