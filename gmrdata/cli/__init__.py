"""The command line: one verb per capability.  Each verb imports its stage only when it runs."""

import io
import re
import signal
import sys
import threading
import traceback
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout, suppress
from dataclasses import fields, is_dataclass
from functools import wraps
from inspect import getdoc, isclass, isfunction, signature
from itertools import chain
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any, get_args, get_origin

import tyro
from tyro.conf import Positional, UseAppendAction

import gmrdata.cli.doctor as _doctor
from gmrdata import __version__
from gmrdata.cli.answers import answer, as_loud, explain, fail
from gmrdata.cli.baselines import baseline
from gmrdata.cli.export import export
from gmrdata.cli.fusion import delta_errors, fuse
from gmrdata.cli.gmr import compare, evaluate, infer, train
from gmrdata.cli.motion_files import fetch, manifest, motions, render
from gmrdata.cli.paper_tables import tables
from gmrdata.cli.pseudo_gt import floor, threedpw
from gmrdata.cli.recipes import demo, report, run
from gmrdata.cli.shards import merge, share
from gmrdata.cli.video import masks, page, sfm, video
from gmrdata.stage.progress import answers, remark
from gmrdata.values.errors import GmrdataError, MissingInput, nearest

_NETWORKS = {
    "--model": "--detector",
    "--landmarks": "--landmark-network",
    "--weights": "--maskrcnn",
}
_ROOT = {"--root": "--threedpw"}
RENAMED: Mapping[str, Mapping[str, str]] = {
    "masks": _NETWORKS | {"--sources": "--masks"},
    "sfm": _NETWORKS | {"--frames": "the folder or file alone, without a flag"},
    "video": _NETWORKS | {"--fps": "--fps-hz"},
    "baseline": {flag: _NETWORKS[flag] for flag in ("--model", "--landmarks")},
    "threedpw": _ROOT,
    "run": _ROOT,
    "floor": {"--frames": "--clip-frames"},
    "tables": {"--held-out": "--held-out-subjects"},
    "fuse": {"--gmr": "--network"},
    "delta-errors": {"--manifests": "manifests stand first, and networks after --network"},
    "evaluate": {"--predictions": "gmrdata evaluate PREDICTIONS MANIFEST"},
}
"""Of each verb, flags of earlier versions and what stands for them now."""


NO_LISTS = (Positional, UseAppendAction)
"""Marks of what is no flag, and of flags that add to what was given before."""


def misspelled(arguments: Sequence[str], verbs: Collection[str]) -> str | None:
    """What is wrong with a command line before any verb looks at it; None if nothing is."""
    if not arguments or arguments[0].startswith("-"):
        return None
    verb, *rest = arguments
    if verb not in verbs:
        return f"there is no verb {verb!r}{nearest(verb, verbs)}. `gmrdata --help` lists them"
    return next(chain(_renamed(verb, rest), _repeated(verb, rest)), None)


def _repeated(verb: str, rest: Sequence[str]) -> Iterator[str]:
    """Flags of several values that one means to add to where one gives them again; of any other
    flag the last one counts, as scripts rely on."""
    flags = Counter(word.split("=")[0].replace("_", "-") for word in rest)
    for flag in lists_of(VERBS[verb]):
        if flags[flag] > 1:
            yield f"{flag} is given {flags[flag]} times. Give it once, with all its values after it"


def lists_of(call: Callable[..., object]) -> Iterator[str]:
    """Flags of several values of a verb, of its own verbs, which bear its name, and of its groups
    of flags; not those that add to what was given before."""
    for name, own in vars(sys.modules[call.__module__]).items():
        if name.startswith(f"{call.__name__}_") and isfunction(own):
            yield from lists_of(own)
    for name, parameter in signature(call).parameters.items():
        said = parameter.annotation
        kind, *marks = get_args(said) if get_origin(said) is Annotated else (said,)
        if isclass(kind) and is_dataclass(kind):
            yield from lists_of(kind)
        elif get_args(kind)[1:] == (...,) and not any(mark in NO_LISTS for mark in marks):
            yield f"--{name.replace('_', '-')}"


def _renamed(verb: str, rest: Sequence[str]) -> Iterator[str]:
    if verb == "infer" and len(rest) > 1 and not any(word.startswith("-") for word in rest[:2]):
        run, poses = rest[:2]
        yield f"infer takes the network with a flag now: gmrdata infer {poses} --network {run}"
    for word in rest:
        flag = word.split("=")[0].replace("_", "-")
        if flag in RENAMED.get(verb, {}):
            yield f"{verb} {flag} has another name now: {RENAMED[verb][flag]}"


_VERBS: tuple[Callable[..., None], ...] = (
    demo, _doctor.doctor, _doctor.blender, fetch, motions, render, masks, sfm, video, page,
    manifest, threedpw, floor, train, infer, delta_errors, fuse, evaluate, compare, export,
    baseline, tables, merge, report, run,
)  # fmt: skip
OUTPUTS = ("out", "redo", "run", "demo_out")
"""Arguments of verbs that name no file to read."""
WITH_REMEDIES = ("detector", "landmark_network", "maskrcnn", "errors")
"""Files whose own messages say, too, what makes or fetches them."""
WORDS = ("anny", "own", "none", "bundled")
"""What may stand for a path where a verb says so."""


def _looked_at(verb: Callable[..., None]) -> Callable[..., None]:
    """The verb, that says first which of its files are not there."""

    @wraps(verb)
    def looks(*args: Any, **given: Any) -> None:
        for path in _paths(signature(verb).bind(*args, **given).arguments):
            if str(path) not in WORDS and not path.exists():
                raise MissingInput(f"{path}: no such file or folder")
        verb(*args, **given)

    return looks


def _paths(arguments: Mapping[str, Any]) -> Iterator[Path]:
    """The files that a verb is given, those in groups of flags too."""
    for name, value in arguments.items():
        if name in (*OUTPUTS, *WITH_REMEDIES):
            continue
        if isinstance(value, Path) or (name == "body" and value is not None):  # a text
            yield Path(value).expanduser()
        elif isinstance(value, tuple):
            yield from (one for one in value if isinstance(one, Path))
        elif is_dataclass(value) and not isinstance(value, type):
            yield from _paths({one.name: getattr(value, one.name) for one in fields(value)})


def _first_file_is_there(arguments: Sequence[str]) -> None:
    """MissingInput where the first word after a verb names a file or folder that is not there:
    said before flags that are missing."""
    verb, word = [*arguments, "", ""][:2]
    if verb not in VERBS or not word or word.startswith("-") or word in WORDS:
        return
    first = next(iter(signature(VERBS[verb]).parameters.values()))
    kinds = get_args(first.annotation)[:1]  # of a positional one; flags are not annotated so
    if kinds in ((Path,), (tuple[Path, ...],)) and not Path(word).exists():
        raise MissingInput(f"{word}: no such file or folder")


def _tell_in_lines(modules: Collection[ModuleType]) -> None:
    """Make each paragraph and flag in the docstrings one line: tyro keeps line breaks of verbs."""
    for module in modules:
        for verb in filter(isfunction, vars(module).values()):
            if verb.__module__ == module.__name__ and (told := getdoc(verb)):
                verb.__doc__ = re.sub(r"(?<=[^\n:])\n(?:(?=\S)| {8,})", " ", told)


_tell_in_lines({sys.modules[verb.__module__] for verb in _VERBS})
VERBS = {verb.__name__.replace("_", "-"): _looked_at(verb) for verb in _VERBS}


class Terminated(KeyboardInterrupt):
    """SIGTERM, as a cluster sends it at the end of a job's time."""


@contextmanager
def _terms() -> Iterator[None]:
    """SIGTERM ends what is inside as Ctrl-C does."""

    def end(*_: object) -> None:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # what is under way is put away in peace
        raise Terminated

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


READERS = {
    "render": "", "floor": "", "demo": "", "run": "", "infer": "--fps-hz --joint-map",
}  # fmt: skip
"""Verbs that read motion files without all flags of `motions`, and those that they have."""


def _elsewhere(verb: str, message: str) -> str:
    """Where a flag is that a message of a reader of motions names, if the verb lacks it."""
    flags = re.findall(r"--(?:fps-hz|unit-m|joint-map|rest-pose|up)\b", message)
    if verb not in READERS or not (lacks := [flag for flag in flags if flag not in READERS[verb]]):
        return ""
    give = f"`gmrdata motions FILE {lacks[0]} ... --out DIR` has it; give {verb} DIR/clips"
    recipe = ", or say it under `read` in the recipe" if verb in ("render", "run") else ""
    return f" ({give}{recipe})"


QUIET, VERBOSE = ("-q", "--quiet"), ("-v", "--verbose")
ALL_HELP = "--help-all"
COMPLETION = "--completion"
FILES_TOO = {
    '  if [[ "$completions" ==': '  if [[ -z "$completions" || "$completions" ==',
    'COMPREPLY=($(compgen -f -- "$cur"))': "COMPREPLY=()",
    "complete -F": "complete -o default -F",
}
"""Lines of the scripts that complete nothing but flags and verbs, and what completes files too."""
ABOUT = """World-frame human motion data.

With any verb: -q says only answers and errors; -v says each stage, and where an error is from."""


def main(arguments: list[str] | None = None) -> None:
    """Entry point: 0 when done, 1 for an error in input or work, 2 for wrong flags."""
    if isinstance(sys.stdout, io.TextIOWrapper):  # its encoding may lack a name's letters
        sys.stdout.reconfigure(errors="backslashreplace")
    given = sys.argv[1:] if arguments is None else arguments
    arguments = [_from_home(word) for word in given if word not in QUIET + VERBOSE]
    verbose = any(word in VERBOSE for word in given)
    with as_loud(quiet=any(word in QUIET for word in given), verbose=verbose):
        try:
            _main(arguments)
        except GmrdataError as error:
            if verbose:
                remark(traceback.format_exc())
            fail(f"{error}{_elsewhere(arguments[0] if arguments else '', str(error))}")
        except BrokenPipeError:
            answers.on_broken_pipe()  # who reads has enough, as `head`: ends with 1
        except OSError as error:
            fail(explain(error))
        except KeyboardInterrupt as error:
            code = 143 if isinstance(error, Terminated) else 130
            fail("stopped. The same command goes on where it was", code=code)


def _from_home(word: str) -> str:
    """A word with the home folder for a leading ~, which bash leaves there in `--out=~/walk`."""
    return re.sub("^(--[^=]+=)?~(?=/|$)", lambda at: f"{at[1] or ''}{Path.home()}", word)


def _parse(arguments: list[str]) -> None:
    """Run the verb that is named; SystemExit after a help or for wrong flags."""
    tyro.extras.subcommand_cli_from_dict(VERBS, prog="gmrdata", description=ABOUT, args=arguments)


def help_of(words: list[str]) -> str:
    """What a verb says with `--help`, in boxes or, where standard output is so, in ASCII."""
    said = io.TextIOWrapper(io.BytesIO(), encoding=answers.encoding)
    with redirect_stdout(said), suppress(SystemExit):
        _parse([*words, "--help"])
    said.seek(0)
    return said.read()


def completion_script(shell: str) -> str:
    """What a shell completes by: tyro's script, with descriptions of one line, and for files."""
    script = io.StringIO()
    with redirect_stdout(script), suppress(SystemExit):
        _parse(["--tyro-write-completion", shell, "-"])
    lines = script.getvalue().splitlines()
    at = next(i for i, line in enumerate(lines) if line.startswith("COMPLETION_SPEC ="))
    lines[at] = lines[at].replace(r"\n", " ").replace("%%", "%")
    text = "\n".join(lines)
    for before, now in FILES_TOO.items():
        text = text.replace(before, now)
    return text


def _usual_help(verb: str) -> str:
    """A verb's help without the groups of flags that are rarely needed, which it names."""
    panels = re.split(r"^(?=(?:╭─)? (?:\w+ )?options )", help_of([verb]), flags=re.MULTILINE)
    groups = [re.match(r"(?:╭─)? (\w+) options ", panel) for panel in panels]
    usual = [panel for panel, group in zip(panels, groups, strict=True) if group is None]
    more = f"Flags of {', '.join(group[1] for group in groups if group)}: gmrdata {verb} {ALL_HELP}"
    return f"{''.join(usual).rstrip()}\n{more}"


def _main(arguments: list[str]) -> None:
    if arguments == ["--version"]:
        answer(f"gmrdata {__version__}")
        return
    if arguments[:1] == [COMPLETION]:
        if arguments[1:] not in (["bash"], ["zsh"]):
            fail(f"{COMPLETION}: give bash or zsh", code=2)
        answer(completion_script(arguments[1]))
        return
    if wrong := misspelled(arguments, VERBS):
        fail(wrong, code=2)
    if arguments in (["video", "--help"], ["video", "-h"]):
        answer(_usual_help("video"))
        return
    arguments = ["--help" if word == ALL_HELP else word for word in arguments]
    _first_file_is_there(arguments)
    with _terms(), share(arguments):
        _parse(arguments)
