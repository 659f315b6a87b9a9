"""The commands that stand in the pages, and what the command line makes of them."""

import functools
import re
import shlex
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import tyro

from gmrdata.cli import VERBS, baselines, motion_files, pseudo_gt
from tests.folders import REPOSITORY

PAGES = ("README.md", "CONTRIBUTING.md", "manifests/FORMAT.md")
BLOCK = re.compile(r"^```(?:sh|bash)\n(.*?)^```", re.MULTILINE | re.DOTALL)
INLINE = re.compile(r"`(gmrdata [^`\n]+)`")
COMMENT = re.compile(r"(?:^|\s)#\s.*$")
NEEDS = re.compile(r"\bneeds\b")
"""The word by which a page says that a command takes more than the repository has."""
SUBVERBS: dict[str, Callable[..., None]] = {
    "manifest check": motion_files.manifest_check,
    "manifest show": motion_files.manifest_show,
    "manifest diff": motion_files.manifest_diff,
    "threedpw regenerate": pseudo_gt.threedpw_regenerate,
    "threedpw list": pseudo_gt.threedpw_list,
    "threedpw show": pseudo_gt.threedpw_show,
    "threedpw compare": pseudo_gt.threedpw_compare,
    "threedpw twin": pseudo_gt.threedpw_twin,
    "baseline zero": baselines.baseline_zero,
    "baseline mean": baselines.baseline_mean,
    "baseline camera_as_world": baselines.baseline_camera_as_world,
    "baseline vibe_cam": baselines.baseline_vibe_cam,
    "baseline own_poses": baselines.baseline_own_poses,
    "baseline joint_train": baselines.baseline_joint_train,
    "baseline joint": baselines.baseline_joint,
}
FUNCTIONS = VERBS | SUBVERBS


@dataclass(frozen=True)
class Command:
    """One command of a page."""

    page: str
    words: tuple[str, ...]
    said: str
    """The comment behind it, and the comments of its block that have a line of their own."""

    @property
    def arguments(self) -> tuple[str, ...]:
        """What `gmrdata` is given; empty for other programs."""
        at = next((i for i, word in enumerate(self.words) if Path(word).name == "gmrdata"), None)
        starts = at == 0 or (at is not None and self.words[at - 1] == "-m")
        return self.words[at + 1 :] if starts and at is not None else ()

    @property
    def needs(self) -> bool:
        return NEEDS.search(self.said) is not None

    def __str__(self) -> str:
        return f"{self.page}: {' '.join(self.words)}"


def pages() -> list[Path]:
    return [*(REPOSITORY / name for name in PAGES), *sorted((REPOSITORY / "docs").glob("*.md"))]


def commands() -> list[Command]:
    """Every command of every block, in the order of the pages."""
    return [command for page in pages() for command in _of_page(page)]


def _of_page(page: Path) -> list[Command]:
    text, found = page.read_text(encoding="utf-8"), []
    for block in BLOCK.finditer(text):
        lines = block[1].replace("\\\n", " ").splitlines()
        whole = " ".join(line for line in lines if line.startswith("#"))
        for line in lines:
            comment = COMMENT.search(line)
            said = f"{whole} {comment[0] if comment else ''}"
            name = page.relative_to(REPOSITORY).as_posix()
            for part in re.split(r"&&|;|\||>", COMMENT.sub("", line)):
                if words := tuple(shlex.split(part)):
                    found.append(Command(name, words, said))
    return found


def inline_commands(page: Path) -> list[tuple[str, ...]]:
    """Arguments of `gmrdata ...` in a page's text."""
    text = BLOCK.sub("", page.read_text(encoding="utf-8"))
    return [tuple(shlex.split(found))[1:] for found in INLINE.findall(text)]


def verb_of(arguments: tuple[str, ...]) -> str:
    """`threedpw list`, `train`."""
    pair = " ".join(arguments[:2])
    return pair if pair in SUBVERBS else arguments[0]


def flags_of(arguments: tuple[str, ...]) -> frozenset[str]:
    return frozenset(word.partition("=")[0] for word in arguments if word.startswith("--"))


def parse(arguments: tuple[str, ...]) -> None:
    """What the command line does before a verb begins; SystemExit where it would refuse."""
    verb = verb_of(arguments)
    function = FUNCTIONS[verb]

    @functools.wraps(function)
    def nothing(*_: object, **__: object) -> None:
        return

    tyro.cli(nothing, args=list(arguments[len(verb.split()) :]))
