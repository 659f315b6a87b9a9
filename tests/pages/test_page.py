"""The page holds every figure that it was given, and nothing from outside."""

import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from markupsafe import Markup

from gmrdata.pages import frames
from gmrdata.pages import report as report_page
from gmrdata.pages.report import page, write_report
from gmrdata.pages.report_data import ReportData
from gmrdata.values.errors import BadFrames
from tests.browser import Visit
from tests.pages.html_pages import Page


def read(html: str) -> Page:
    """The page, whose tags are closed in order."""
    return Page(Path("report.html"), html)


@pytest.fixture(scope="module")
def html(report: ReportData) -> str:
    return page(report)


def test_tags_are_closed_in_order_and_ids_are_unique(html: str) -> None:
    ids = read(html).of("id")
    assert len(ids) == len(set(ids)) > 20


def test_nothing_is_loaded_from_outside(html: str) -> None:
    reader = read(html)
    links = reader.of("src", "href", "xlink:href")
    assert len(links) > 20
    assert all(link.startswith(("#", "data:image/")) for link in links)
    assert not re.search(r"@import|url\((?!#)", html)
    assert not set(reader.tags) & {"script", "link", "iframe", "object", "embed"}


def test_anchors_lead_somewhere(html: str) -> None:
    reader = read(html)
    inner = [value for tag, name, value in reader.values if (tag, name) == ("a", "href")]
    assert inner
    assert {link.removeprefix("#") for link in inner} <= set(reader.of("id"))


def test_sections_show_the_figures_that_were_given(html: str) -> None:
    sections = read(html).sections
    assert list(sections)[:3] == ["header", "summary", "clip-0"]
    for figure in ("walk_circular", "12/12", "0.123", "4.57", "0.057", "−1.23", "≤ 0.5", "≤ 15"):
        assert figure in sections["summary"]
    assert "3 of 3 clips meet every threshold" in sections["summary"]
    shown = {
        "clip-0": (
            "walk_circular", "0.123°", "4.57 mm", "0.7654 ± 0.0123 (±\u00a01.6\u00a0%)", "0.43 px",
            "200 to 211", "the global mapper",
        ),
        "clip-2": ("not observable (pan)",),
        "gmr": ("3.21", "7.65", "43.2", "120.1", "54.3", "130.2", "pseudo-gt", "131.2"),
        "making": ("61.2 s", "113.8 s", "1.26.4", "cameras: [circular, linear, panning]"),
        "meaning": ("The model was trained for half a minute.", "(eq. 15)"),
    }  # fmt: skip
    for section, figures in shown.items():
        for figure in figures:
            assert figure in sections[section], figure


def test_same_input_gives_same_bytes(html: str, report: ReportData, tmp_path: Path) -> None:
    again = write_report(tmp_path / "a.html", report).read_bytes()
    assert again == html.encode()
    assert [p.name for p in tmp_path.iterdir()] == ["a.html"]


def test_values_are_escaped(report: ReportData) -> None:
    evil = '<script>alert("&")</script>'
    clip = report.clips[0]
    clip = replace(
        clip,
        id=evil,
        camera_motion=evil,
        quality=replace(clip.quality, geometry=evil, notes=((evil, evil),)),
        true=replace(clip.true, motion=replace(clip.true.motion, source=evil)),
    )
    run = replace(
        report.run, title=evil, data_source=evil, recipe=evil, limits=(evil,),
        seconds={evil: 1.0}, versions={evil: evil},
    )  # fmt: skip
    scores = {evil: report.scores["truth"]}
    html = page(replace(report, run=run, clips=(clip,), scores=scores))
    reader = read(html)
    assert "<script" not in html
    assert {"header", "summary", "clip-0", "gmr", "making", "meaning"} == set(reader.sections)
    assert all(evil in text for text in reader.sections.values())


def test_a_missed_threshold_is_said_in_words(
    report: ReportData, monkeypatch: pytest.MonkeyPatch
) -> None:
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


def test_parts_that_are_missing_leave_no_hole(report: ReportData) -> None:
    clip = report.clips[1]
    bare = replace(
        clip,
        masks_dir=None,
        predicted=None,
        quality=replace(
            clip.quality, scale=None, scale_sigma=None, reprojection_error_px=None, inliers=None,
            notes=(),
        ),
        figures=clip.figures.model_copy(
            update={"scale_error_percent": None, "camera_rotation_deg": None}
        ),
    )  # fmt: skip
    run = replace(report.run, seconds={}, versions={}, recipe="", limits=())
    html = page(ReportData(run=run, clips=(bare,)))
    reader = read(html)
    assert set(reader.sections) == {"header", "summary", "clip-0", "making", "meaning"}
    assert "None" not in html
    assert "nan" not in re.sub(r'"data:[^"]*"', "", html).lower()
    assert "does not enter" in reader.sections["clip-0"]


def test_frames_without_a_camera_are_named(report: ReportData) -> None:
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


def test_a_run_without_a_clip_still_has_a_page(report: ReportData) -> None:
    assert "No clip was recovered." in page(replace(report, clips=()))


def test_a_missing_image_is_named_and_nothing_is_written(
    report: ReportData, tmp_path: Path
) -> None:
    shutil.copytree(report.clips[1].images_dir, tmp_path / "frames")
    clip = replace(report.clips[1], images_dir=tmp_path / "frames")
    (clip.images_dir / "00011.jpg").unlink()
    with pytest.raises(BadFrames, match="no image of number 11"):
        write_report(tmp_path / "report.html", replace(report, clips=(clip,)))
    (clip.images_dir / "00011.jpg").write_bytes(b"not a picture")
    with pytest.raises(BadFrames, match=r"00011\.jpg: missing, or not an image"):
        write_report(tmp_path / "report.html", replace(report, clips=(clip,)))
    assert [path.name for path in tmp_path.iterdir()] == ["frames"]


def test_a_browser_opens_it_without_a_complaint(
    html: str, browse: Callable[[Path], Visit], tmp_path: Path
) -> None:
    # These are the bytes that `write_report` writes.
    (tmp_path / "report.html").write_bytes(html.encode())
    seen = browse(tmp_path / "report.html")
    assert (seen.complaints, seen.requests) == ([], [])
    dom = read(seen.dom)
    assert "walk_panning" in dom.sections["clip-2"]
    assert sum(tag == "img" and name == "src" for tag, name, _ in dom.values) == 36
