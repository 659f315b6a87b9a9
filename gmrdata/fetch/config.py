"""How files are fetched."""

from pydantic import Field

from gmrdata.config import Config
from gmrdata.fetch.trials import CMU_URL


class FetchConfig(Config):
    """Where from, and how patiently."""

    base_url: str = CMU_URL
    """Folder with one folder per subject; http or https."""
    timeout_s: float = Field(default=30.0, gt=0)
    """Longest silence of the server [s]."""
    file_limit_s: float = Field(default=900.0, gt=0)
    """Longest time for one attempt at one file [s]."""
    attempts: int = Field(default=5, ge=1)
    """Attempts at one file."""
    first_wait_s: float = Field(default=1.0, ge=0)
    """Mean wait before the second attempt; it doubles with each further one [s]."""
    longest_wait_s: float = Field(default=30.0, ge=0)
    """Upper bound of the mean wait [s]."""
    largest_bytes: int = Field(default=1 << 28, gt=0)
    """A longer answer is no motion file and is refused [bytes]."""
