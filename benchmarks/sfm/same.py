"""Whether two runs of one recipe left the same: manifest, verdicts and arrays, bit for bit."""

from pathlib import Path

from sfm.ours import Regenerated

from gmrdata.values.files import sha256_of_path

WHOLE_STAGES = ("people", "masks", "sfm", "pseudo_gt")


def differences(first: Regenerated, second: Regenerated, names: list[str]) -> list[str]:
    """Files and folders, relative to the runs' folders, that differ.

    Times stand in stage records alone, which don't count.

    Args:
        first: One run.
        second: The other.
        names: Their sequences.
    """
    parts = [Path("pseudo_gt.yaml"), Path("verdicts.json")]
    parts += [Path("sequences") / name / stage for name in names for stage in WHOLE_STAGES]
    return [str(part) for part in parts if _hash(first.root / part) != _hash(second.root / part)]


def _hash(path: Path) -> str:
    """Of a file, or of all in a folder; "missing" for a stage that failed in both."""
    return sha256_of_path(path) if path.exists() else "missing"
