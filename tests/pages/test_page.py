"""The page of a set holds every figure that it was given; the terminal shows them in 80 columns."""

import json
import re
import shutil
from collections.abc import Sequence
from dataclasses import replace
from io import StringIO
from pathlib import Path
from unittest.mock import Mock

import cv2
import numpy as np
import pytest
from markupsafe import Markup
from rich.console import Console

from gmrdata.film import render
from gmrdata.film.render import find_renderer
from gmrdata.film.set_plan import SyntheticRecipe
from gmrdata.pages import frames, sets
from gmrdata.pages import report as report_page
from gmrdata.pages.report import page, summary_table, write_report
from gmrdata.pages.report_data import (
    ClipAccuracy,
    ReportData,
    Summary,
    figure_texts,
    summary,
    verdicts,
)
from gmrdata.pages.sets import preview_set
from gmrdata.read.body_file import save_body
from gmrdata.stage import workers
from gmrdata.stage.jobs import Job, Outcome
from gmrdata.values.errors import BadFrames, EngineMissing
from tests.pages.html_pages import Page
from tests.record_keys import assert_each_key_is_needed


def read(html: str) -> Page:
    """The page, whose tags are closed in order."""
    return Page(Path("report.html"), html)


@pytest.fixture(scope="module")
def html(report) -> str:
    return page(report)


def test_tags_are_closed_in_order_and_ids_are_unique(html):
    ids = read(html).of("id")
    assert len(ids) == len(set(ids)) > 20


def test_nothing_is_loaded_from_outside(html):
    reader = read(html)
    links = reader.of("src", "href", "xlink:href")
    assert len(links) > 20
    assert all(link.startswith(("#", "data:image/")) for link in links)
    assert not re.search(r"@import|url\((?!#)", html)
    assert not set(reader.tags) & {"script", "link", "iframe", "object", "embed"}


def test_anchors_lead_somewhere(html):
    reader = read(html)
    inner = [value for tag, name, value in reader.values if (tag, name) == ("a", "href")]
    assert inner
    assert {link.removeprefix("#") for link in inner} <= set(reader.of("id"))


def test_sections_show_the_figures_that_were_given(html):
    sections = read(html).sections
    assert list(sections)[:3] == ["header", "summary", "clip-0"]
    for figure in ("walk_circular", "12/12", "0.123", "4.57", "0.057", "−1.23", "≤ 0.5", "≤ 15"):
        assert figure in sections["summary"]
    assert "3 of 3 clips meet every threshold" in sections["summary"]
    shown = {
        "clip-0": (
            "walk_circular", "0.123°", "4.57 mm", "0.7654 ± 0.0123 (±\u00a01.6\u00a0%)", "0.43 px",
            "200 to 211",
        ),
        "clip-2": ("not observable (pan)",),
        "gmr": ("3.21", "7.65", "43.2", "120.1", "54.3", "130.2", "pseudo-gt", "131.2"),
        "making": ("61.2 s", "113.8 s", "1.26.4", "cameras: [circular, linear, panning]"),
        "meaning": ("(eq. 15)",),
    }  # fmt: skip
    for section, figures in shown.items():
        for figure in figures:
            assert figure in sections[section], figure


def test_same_input_gives_same_bytes(html, report, tmp_path):
    again = write_report(tmp_path / "a.html", report).read_bytes()
    assert again == html.encode()
    assert [p.name for p in tmp_path.iterdir()] == ["a.html"]


def test_values_are_escaped(report):
    evil = '<script>alert("&")</script>'
    clip = report.clips[0]
    clip = replace(
        clip,
        id=evil,
        camera_motion=evil,
        true=replace(clip.true, motion=replace(clip.true.motion, source=evil)),
    )
    made = replace(
        report, title=evil, data_source=evil, recipe=evil,
        seconds={evil: 1.0}, versions={evil: evil},
    )  # fmt: skip
    scores = {evil: report.scores["truth"]}
    html = page(replace(made, clips=(clip,), scores=scores))
    reader = read(html)
    assert "<script" not in html
    assert {"header", "summary", "clip-0", "gmr", "making", "meaning"} == set(reader.sections)
    assert all(evil in text for name, text in reader.sections.items() if name != "meaning")


def test_a_missed_threshold_is_said_in_words(report, monkeypatch):
    # The drawings say nothing of it, and five pages of them take their time.
    monkeypatch.setattr(frames, "frame_tiles", lambda *_: [])
    monkeypatch.setattr(report_page, "svg", lambda *_: Markup(""))
    clip = report.clips[0]
    for worse in (
        {"ome_deg": 0.51}, {"tme_mm": 15.2}, {"scale_error_percent": -5.1},
        {"frames_with_camera": 11}, {"ome_deg": float("nan")},
    ):  # fmt: skip
        bad = replace(clip, figures=clip.figures.model_copy(update=worse))
        summary = read(page(replace(report, clips=(bad,)))).sections["summary"]
        assert "0 of 1 clips meet every threshold" in summary
        assert "✗" in summary


def test_parts_that_are_missing_leave_no_hole(report):
    clip = report.clips[1]
    bare = replace(
        clip,
        masks_dir=None,
        predicted=None,
        quality=clip.quality.model_copy(update={"scale": None, "scale_sigma": None}),
        figures=clip.figures.model_copy(
            update={"scale_error_percent": None, "camera_rotation_deg": None}
        ),
    )
    html = page(ReportData(report.title, report.data_source, seconds={}, clips=(bare,)))
    reader = read(html)
    assert set(reader.sections) == {"header", "summary", "clip-0", "making", "meaning"}
    assert "None" not in html
    assert "nan" not in re.sub(r'"data:[^"]*"', "", html).lower()
    assert "does not enter" in reader.sections["clip-0"]


def test_frames_without_a_camera_are_named(report):
    clip = report.clips[0]
    camera = clip.pseudo.camera
    assert camera is not None
    lost = np.arange(clip.pseudo.motion.n_frames) >= 6
    world_from_cam = np.where(lost[:, None, None], np.nan, camera.world_from_cam)
    motion = replace(
        clip.pseudo.motion,
        root_rotmats=np.where(lost[:, None, None], np.nan, clip.pseudo.motion.root_rotmats),
        pelvis_m=np.where(lost[:, None], np.nan, clip.pseudo.motion.pelvis_m),
    )
    pseudo = replace(
        clip.pseudo,
        motion=motion,
        valid=~lost,
        camera=replace(camera, world_from_cam=world_from_cam, has_camera=~lost),
    )
    figures = clip.figures.model_copy(update={"frames_with_camera": 6})
    html = page(replace(report, clips=(replace(clip, pseudo=pseudo, figures=figures),)))
    assert html.count("· no camera</span>") == 6
    assert "6/12" in html


def test_a_run_without_a_clip_still_has_a_page(report):
    assert "No clip was recovered." in page(replace(report, clips=()))


def test_a_missing_image_is_named_and_nothing_is_written(report, tmp_path):
    shutil.copytree(report.clips[1].images_dir, tmp_path / "frames")
    clip = replace(report.clips[1], images_dir=tmp_path / "frames")
    (clip.images_dir / "00011.jpg").unlink()
    with pytest.raises(BadFrames, match="no image of number 11"):
        write_report(tmp_path / "report.html", replace(report, clips=(clip,)))
    (clip.images_dir / "00011.jpg").write_bytes(b"not a picture")
    with pytest.raises(BadFrames, match=r"00011\.jpg: missing or cannot be decoded"):
        write_report(tmp_path / "report.html", replace(report, clips=(clip,)))
    assert [path.name for path in tmp_path.iterdir()] == ["frames"]


def test_a_browser_opens_it_without_a_complaint(html, browse, tmp_path):
    # These are the bytes that `write_report` writes.
    (tmp_path / "report.html").write_bytes(html.encode())
    seen = browse(tmp_path / "report.html")
    assert (seen.complaints, seen.requests) == ([], [])
    dom = read(seen.dom)
    assert "walk_panning" in dom.sections["clip-2"]
    assert sum(tag == "img" and name == "src" for tag, name, _ in dom.values) == 36


def printed(figures: Summary, width: int = 80) -> str:
    stream = StringIO()
    Console(file=stream, width=width, color_system=None).print(summary_table(figures))
    return stream.getvalue()


def test_summary_holds_the_figures_and_survives_json(report, tmp_path):
    summary(report).write(tmp_path / "summary.json")
    figures = json.loads((tmp_path / "summary.json").read_text())
    assert figures["clips"][0] == {
        "id": "walk_circular",
        "camera_motion": "circular",
        "ome_deg": 0.1234,
        "tme_mm": 4.567,
        "camera_rotation_deg": 0.0567,
        "scale_error_percent": -1.234,
        "frames": 12,
        "frames_with_camera": 12,
    }
    assert figures["clips"][2]["scale_error_percent"] is None
    assert figures["gmr"]["truth"] == {
        "ome_deg": 3.21, "tme_mm": 43.2, "vme_mm": 54.3,
        "zero_motion": {"ome_deg": 7.65, "tme_mm": 120.1, "vme_mm": 130.2},
    }  # fmt: skip
    assert figures["seconds"] == {"render": 61.25, "reconstruct": 40.5, "train": 12.0}
    assert_each_key_is_needed(summary(report), tmp_path / "summary.json", ("gmr", "seconds"))


def test_rows_show_every_figure(report):
    lines = printed(summary(report)).splitlines()
    row = next(line for line in lines if "walk_circular" in line)
    assert row.split() == ["walk_circular", "12/12", "0.123", "4.57", "0.057", "−1.23"]
    assert any("walk_panning" in line and "not observable (pan)" in line for line in lines)
    row = next(line for line in lines if line.strip().startswith("truth"))
    assert row.split() == ["truth", "3.21", "(7.65)", "43.2", "(120.1)", "54.3", "(130.2)"]
    assert "114 s in all: render 61 s · reconstruct 40 s · train 12 s" in lines[-1]


def test_long_names_and_bad_figures_fit_into_80_columns(report):
    found = summary(report)
    long = {
        "id": "a_clip_with_a_name_that_goes_on_and_on_and_on",
        "ome_deg": 123.456,
        "tme_mm": 98765.4,
        "camera_rotation_deg": 179.9,
        "frames": 1000,
        "frames_with_camera": 999,
    }
    clips = (*found.clips[:2], found.clips[2].model_copy(update=long))
    gmr = {"a manifest with a long name " * 4: found.gmr["truth"]}
    text = printed(found.model_copy(update={"clips": clips, "gmr": gmr}))
    assert max(map(len, text.splitlines())) <= 80
    for figure in ("999/1000", "123.456", "98765.40", "179.900", "not observable (pan)", "(130.2)"):
        assert figure in text


def test_names_are_not_markup(report):
    clips = (replace(report.clips[0], id="[red]x[/red]"),)
    assert "[red]x[/red]" in printed(summary(replace(report, clips=clips)))


def test_parts_that_are_missing_are_left_out(report):
    text = printed(summary(replace(report, scores={}, seconds={})))
    assert "GMR" not in text
    assert "in all" not in text


GOOD = ClipAccuracy(
    ome_deg=0.1, tme_mm=1.0, camera_rotation_deg=0.1, scale_error_percent=0.0,
    frames=48, frames_with_camera=48,
)  # fmt: skip


@pytest.mark.parametrize(
    ("changed", "missed"),
    [
        ({}, set()),
        ({"ome_deg": 0.5, "tme_mm": 15.0, "scale_error_percent": 5.0}, set()),
        ({"scale_error_percent": -5.001}, {"scale_error_percent"}),
        ({"ome_deg": float("nan")}, {"ome_deg"}),
        ({"frames_with_camera": 47}, {"frames_with_camera"}),
        ({"tme_mm": 15.001}, {"tme_mm"}),
    ],
)
def test_thresholds(changed, missed):
    met = verdicts(GOOD.model_copy(update=changed))
    assert {key for key, good in met.items() if not good} == missed


def test_a_scale_that_does_not_enter_has_no_verdict():
    unknown = {"camera_rotation_deg": None, "scale_error_percent": None}
    figures = GOOD.model_copy(update=unknown)
    assert "scale_error_percent" not in verdicts(figures)
    texts = figure_texts(figures)
    assert texts["scale_error_percent"] == "not observable (pan)"
    assert texts["camera_rotation_deg"] == "–"


@pytest.fixture
def recipe(small_body, tmp_path) -> SyntheticRecipe:
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


def test_a_preview_stays_in_its_folder_and_is_made_once(recipe, tmp_path, monkeypatch):
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


def test_without_opengl_cycles_draws_and_that_is_said(recipe, tmp_path, monkeypatch, capsys):
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
