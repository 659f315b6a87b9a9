"""The take that most tests write."""

from collections.abc import Callable

import pytest

from gmrdata.values.body import BodyModel
from gmrdata.values.motion import Motion
from gmrdata.write.take import Take
from tests.write.takes import make_take


@pytest.fixture(scope="session")
def take(walk: Callable[..., Motion], small_body: BodyModel) -> Take:
    """Someone who walks, a second who is not always there, and a camera with a gap."""
    return make_take(walk, small_body)
