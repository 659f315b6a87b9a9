"""Clips and a small training, as the tests of networks have them."""

from tests.gmr.conftest import make_clips, small_config  # noqa: F401
