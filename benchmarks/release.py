"""Build what is released, install it where nothing is, and try every verb.

`make release` builds a source distribution and a wheel of the last commit, installs each into an
empty environment with constraints.txt, and runs `gmrdata doctor` and a smoke test of every verb
there, in an empty folder with an empty cache.  The two must hold the same files.  What was built
is in out/release/ then.  ARGS='--keep FOLDER' works in that folder and leaves it there.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
import venv
from collections.abc import Iterator, Sequence
from pathlib import Path

from release_smoke import COMMANDS, RECIPES, REFUSED

from gmrdata.cli import VERBS
from gmrdata.stage.progress import answers

REPOSITORY = Path(__file__).resolve().parents[1]
BUILD = """
import sys, setuptools.build_meta as build
dist = sys.argv[1]  # the build puts its own words there
build.build_sdist(dist)
build.build_wheel(dist)
"""
LOG_LINES = 15


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--keep", type=Path, help="work in this folder, which is then kept")
    keep = parser.parse_args().keep
    if keep is not None:
        keep.mkdir(parents=True)
        release(keep.resolve())
        return
    with tempfile.TemporaryDirectory(prefix="gmrdata-release-") as folder:
        release(Path(folder))


def release(folder: Path) -> None:
    """Build, install, try; the built files are copied only where all of it went well."""
    if untried := VERBS.keys() - {command.split()[0] for command in COMMANDS}:
        fail(f"release_smoke.py tries no {', '.join(sorted(untried))}")
    files = build(folder)
    installed = [try_file(file, folder) for file in files]
    if differing := sorted(installed[0] ^ installed[1]):
        fail(f"sdist and wheel install other files: {', '.join(differing[:LOG_LINES])}")
    out = REPOSITORY / "out/release"
    shutil.rmtree(out, ignore_errors=True)
    shutil.copytree(folder / "dist", out)
    say(f"Good: {', '.join(file.name for file in files)} in {out.relative_to(REPOSITORY)}")


def build(folder: Path) -> list[Path]:
    """The wheel and the source distribution of the last commit."""
    if subprocess.check_output(["git", "status", "--porcelain"], cwd=REPOSITORY):
        say("What is not committed is not in the release.")
    tree, dist = folder / "tree", folder / "dist"
    tree.mkdir()
    archive = folder / "tree.tar"
    run(["git", "archive", "--output", str(archive), "HEAD"], REPOSITORY)
    with tarfile.open(archive) as tar:
        tar.extractall(tree, filter="data")
    run([sys.executable, "-c", BUILD, str(dist)], tree)
    files = [next(dist.glob(pattern)) for pattern in ("*.whl", "*.tar.gz")]
    for file in files:
        say(f"{file.name}: {file.stat().st_size / 1e6:.2f} MB")
    return files


def try_file(file: Path, folder: Path) -> set[str]:
    """Install a file and try every verb; the installed files with their hashes."""
    kind = "sdist" if file.suffix == ".gz" else "wheel"
    environment = folder / kind
    seconds = install(file, environment)
    say(f"{kind}: installed in {seconds:.0f} s")
    empty = folder / f"{kind}-work"
    empty.mkdir()
    smoke(environment / "bin/gmrdata", empty, folder / "cache")
    return installed_files(environment)


def install(file: Path, environment: Path) -> float:
    """A new environment with that file and what it asks for; the seconds that it took."""
    start_s = time.monotonic()
    venv.create(environment, with_pip=True)
    pip = [str(environment / "bin/python"), "-m", "pip", "install", "--quiet", "--no-compile"]
    constraints = ["-c", str(REPOSITORY / "constraints.txt")]
    # Modules are compiled when they are used: of most of them the smoke test uses little.
    run([*pip, "--disable-pip-version-check", *constraints, str(file)], environment.parent)
    return time.monotonic() - start_s


def installed_files(environment: Path) -> set[str]:
    """Names and hashes of gmrdata's files, without those that say how it was installed."""
    record = next(environment.glob("lib/python*/site-packages/gmrdata-*.dist-info/RECORD"))
    lines = record.read_text().splitlines()
    return {line for line in lines if line.startswith(("gmrdata/", "blender/"))}


def smoke(gmrdata: Path, empty: Path, cache: Path) -> None:
    """Run every verb in a folder that has only tiny recipes; the first that fails ends it."""
    for name, text in RECIPES.items():
        (empty / name).write_text(text)
    away = ("PYTHON", "GMRDATA")
    outside = {name: text for name, text in os.environ.items() if not name.startswith(away)}
    # Blender's environment is made once, by the first of the two.
    folders = {"XDG_CACHE_HOME": str(cache), "XDG_DATA_HOME": str(cache.with_name("data"))}
    environment = outside | folders | {"COLUMNS": "120"}
    start_s = time.monotonic()
    for command in COMMANDS:
        begun_s = time.monotonic()
        said = run([str(gmrdata), *command.split()], empty, environment, REFUSED.get(command))
        if command == "doctor":
            say(said)
        say(f"  {time.monotonic() - begun_s:5.1f} s  gmrdata {command}")
    say(f"  {time.monotonic() - start_s:5.1f} s  all {len(COMMANDS)} commands")


def run(
    command: Sequence[str],
    folder: Path,
    environment: dict[str, str] | None = None,
    refusal: str | None = None,
) -> str:
    """Run a command, and give what it said.

    The release ends where it fails, or where a command with a `refusal` does not end with 1 and
    these words.
    """
    done = subprocess.run(
        command,
        cwd=folder,
        env=environment,
        check=False,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    as_meant = done.returncode == (refusal is not None) and (refusal or "") in done.stdout
    if not as_meant:
        fail("\n".join([" ".join(command), *last_lines(done.stdout), f"exit {done.returncode}"]))
    return done.stdout


def last_lines(text: str) -> Iterator[str]:
    yield from text.splitlines()[-LOG_LINES:]


def say(text: str) -> None:
    answers.print(text, markup=False, soft_wrap=True)


def fail(text: str) -> None:
    say(text)
    sys.exit(1)


if __name__ == "__main__":
    main()
