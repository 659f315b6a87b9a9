"""The example scripts, on small inputs, as a reader runs them."""

import ast
import runpy
import sys
from collections.abc import Callable

import pytest

from tests.folders import REPOSITORY

FOLDER = REPOSITORY / "examples"
Example = Callable[..., str]
SCRIPTS = sorted(path.name for path in FOLDER.glob("*.py"))
MAY_IMPORT = {
    "gmrdata", "numpy", "matplotlib.pyplot", "argparse", "dataclasses", "pathlib", "sys",
}  # fmt: skip


@pytest.fixture
def example(capsys, monkeypatch) -> Example:
    """Runs a script as `python` does, in this process; gives what it prints."""

    def run(name: str, *arguments: object) -> str:
        path = str(FOLDER / f"{name}.py")
        monkeypatch.setattr(sys, "argv", [path, *map(str, arguments)])
        capsys.readouterr()
        runpy.run_path(path, run_name="__main__")
        return capsys.readouterr().out

    return run


def test_there_are_seven():
    assert SCRIPTS == [
        "plot_path.py",
        "regenerate_threedpw.py",
        "render_clip.py",
        "score_results.py",
        "solve_sequence.py",
        "train_and_score.py",
        "video_to_glb.py",
    ]


@pytest.mark.parametrize("name", ["regenerate_threedpw", "score_results", "video_to_glb"])
def test_a_whole_job_takes_fifteen_lines(name):
    assert len((FOLDER / f"{name}.py").read_text(encoding="utf-8").splitlines()) <= 15


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_script_is_short_and_uses_public_names_alone(name):
    text = (FOLDER / name).read_text(encoding="utf-8")
    assert len(text.splitlines()) < 40
    imported = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            imported |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            imported.add(node.module)
    assert "gmrdata" in imported and imported <= MAY_IMPORT


@pytest.mark.slow
def test_a_clip_is_rendered_and_regenerated(example, tmp_path):
    film = tmp_path / "film"
    said = example("render_clip", film, "--duration-s", 1.5, "--width-px", 320)
    assert "15 frames of 320 x 180 pixels" in said
    assert len(list((film / "clip" / "frames").glob("*.jpg"))) == 15
    said = example(
        "solve_sequence",
        *(film / "clip" / "frames", film / "seen.npz", film / "body.npz", tmp_path / "world"),
        *("--truth", film / "clip" / "clip.npz"),
    )
    assert "15 of 15 frames have a world motion" in said
    paths_m = [float(line.split()[-2]) for line in said.splitlines() if "path" in line]
    assert len(paths_m) == 2 and paths_m[1] > 1.0
    assert paths_m[0] == pytest.approx(paths_m[1], rel=0.1)


@pytest.mark.slow
def test_a_gmr_is_trained_scored_and_plotted(example, tmp_path):
    out = tmp_path / "gmr"
    said = example("train_and_score", out, "--walks", 2, "--steps", 2)
    assert said.splitlines()[-1].startswith("OME ") and " mm" in said
    assert example("score_results", "bundled", out / "scored/motions.yaml", tmp_path / "bundled")
    picture = tmp_path / "path.png"
    example("plot_path", out / "run", out / "files" / "scored" / "scored_0.npz", picture)
    assert picture.read_bytes()[:4] == b"\x89PNG"
