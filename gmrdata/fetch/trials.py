"""Trials of the CMU motion capture database: their names, files and addresses."""

import re
import shlex
from collections.abc import Iterable, Sequence
from pathlib import Path
from urllib.parse import urlsplit

from gmrdata import resources
from gmrdata.errors import BadRecipe
from gmrdata.manifest.current import ListManifest
from gmrdata.manifest.read import read_manifest

CMU_URL = "http://mocap.cs.cmu.edu/subjects"
"""Below it lie `02/02.asf` and `02/02_03.amc`."""
_TRIAL = re.compile(r"[0-9]{2,3}_[0-9]{2}")


def is_trial(name: str) -> bool:
    """Whether a name is one of CMU's trials, `subject_trial`, like 02_03 or 143_18."""
    return _TRIAL.fullmatch(name) is not None


def check_trials(names: Iterable[str]) -> tuple[str, ...]:
    """The names, each once, in their order.

    Raises:
        BadRecipe: a name is not a trial's.
    """
    trials = tuple(dict.fromkeys(names))
    wrong = [repr(name) for name in trials if not is_trial(name)]
    if wrong:
        raise BadRecipe(
            f"{', '.join(wrong)}: no name of a CMU trial; write subject and trial like 02_03"
        )
    return trials


def listed_trials(name: str) -> tuple[str, ...]:
    """CMU's trials in a list that gmrdata publishes, e.g. "paper_table8".

    Raises:
        MissingInput: there is no such list.
        BadRecipe: it names no CMU trials.
    """
    published = read_manifest(resources.published_manifest(name))
    rows = published.clips if isinstance(published, ListManifest) else ()
    trials = [row.source.sequence for row in rows if row.source.dataset == "CMU"]
    if not trials:
        raise BadRecipe(f"--list {name}: names no CMU trials; paper_table8 does")
    return check_trials(trials)


def skeleton_of(trial: str) -> str:
    """File name of a trial's skeleton: 02_03 -> 02.asf."""
    return f"{trial.partition('_')[0]}.asf"


def file_url(base_url: str, name: str) -> str:
    """Address of `02.asf` or `02_03.amc` below `base_url`.

    Raises:
        BadRecipe: `base_url` is no http or https address.
    """
    parts = urlsplit(base_url)
    if parts.scheme not in ("http", "https") or not parts.netloc or parts.query or parts.fragment:
        raise BadRecipe(f"--base-url {base_url}: must be an http:// or https:// folder")
    subject = Path(name).stem.partition("_")[0]
    return f"{base_url.rstrip('/')}/{subject}/{name}"


def fetch_command(trials: Sequence[str], folder: Path | None) -> str | None:
    """The command that gets these trials, or None if none of them is CMU's."""
    wanted = [trial for trial in dict.fromkeys(trials) if is_trial(trial)]
    if not wanted:
        return None
    out = "FOLDER" if folder is None else shlex.quote(str(folder))
    return f"gmrdata fetch cmu {' '.join(wanted)} --out {out}"
