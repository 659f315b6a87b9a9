"""A quick look at a set: small pictures of every clip in a folder of their own."""

from collections.abc import Sequence
from pathlib import Path
from unittest.mock import Mock

import cv2
import pytest

from gmrdata.film import render
from gmrdata.film.render import find_renderer
from gmrdata.film.set_plan import SyntheticRecipe
from gmrdata.pages import sets
from gmrdata.pages.sets import preview_set
from gmrdata.read.body_file import save_body
from gmrdata.stage import workers
from gmrdata.stage.jobs import Job, Outcome
from gmrdata.values.body import BodyModel
from gmrdata.values.errors import EngineMissing


@pytest.fixture
def recipe(small_body: BodyModel, tmp_path: Path) -> SyntheticRecipe:
    save_body(tmp_path / "small.npz", small_body)
    return SyntheticRecipe.model_validate(
        {
            "recipe": "synthetic",
            "name": "look",
            "body": str(tmp_path / "small.npz"),
            "workers": 1,
            "film": {"duration_s": 1.0, "fps_hz": 10, "width_px": 320, "height_px": 180},
            "render": {"scene": {"kind": "room"}},
            "clips": [{"id": "walk", "gait": "walk", "programme": {"kind": "circular"}}],
        }
    )


def files(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


def check_page(page: Path) -> None:
    assert page.name == "index.html" and "clips/walk/contact.jpg" in page.read_text()
    shown = {"stage.json", "contact.jpg", "paths.png"}
    assert {path.name for path in (page.parent / "clips/walk").iterdir()} == shown
    sheet = cv2.imread(str(page.parent / "clips/walk/contact.jpg"))
    assert sheet is not None and sheet.shape == (2 * 135 + 4, 4 * 240 + 3 * 4, 3)
    assert sheet[:135, :240].std() > 25  # there is something to see
    assert abs(sheet[:135, :240].astype(int) - sheet[-135:, -240:]).mean() > 2  # and it moves


def test_a_preview_stays_in_its_folder_and_is_made_once(
    recipe: SyntheticRecipe, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out_dir = tmp_path / "out {of} #1"
    page = preview_set(recipe, out_dir)
    assert page == out_dir / "preview/index.html"
    check_page(page)
    assert all(name.startswith("preview/") for name in files(out_dir))
    written_ns = (page.parent / "clips/walk/contact.jpg").stat().st_mtime_ns
    monkeypatch.delattr(workers, "_local_client")  # no worker is started
    preview_set(recipe, out_dir)
    assert (page.parent / "clips/walk/contact.jpg").stat().st_mtime_ns == written_ns


def in_this_process(_: str, jobs: Sequence[Job], *__: object) -> Outcome:
    return Outcome({job.id: job.call(**job.arguments) for job in jobs}, {})


def test_without_opengl_cycles_draws_and_that_is_said(
    recipe: SyntheticRecipe,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    find_renderer.cache_clear()
    monkeypatch.setenv("__EGL_VENDOR_LIBRARY_FILENAMES", "/nonexistent")
    try:
        with pytest.raises(EngineMissing) as missing:
            find_renderer("workbench", "cpu")
        # That was a start of Blender, and one tells enough; so does one process.
        monkeypatch.setattr(render, "find_renderer", Mock(side_effect=missing.value))
        monkeypatch.setattr(sets, "try_jobs", in_this_process)
        assert sets._choose_engine() == "cycles"
        check_page(preview_set(recipe, tmp_path / "out"))
    finally:
        find_renderer.cache_clear()
    said = capsys.readouterr()
    assert "drawn by Cycles with one ray per pixel" in " ".join((said.out + said.err).split())
