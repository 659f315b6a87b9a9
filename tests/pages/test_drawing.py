"""Pictures of clips and sets: overlays, series, small previews and the sheet of masks."""

import re
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import cv2
import numpy as np
import pytest
from fontTools.ttLib import TTFont
from matplotlib.figure import Figure
from matplotlib.font_manager import findfont, fontManager
from matplotlib.text import Text
from scipy.spatial.transform import Rotation

from gmrdata.pages.frames import TINT_BGR, frame_tiles, make_mask_sheet, mask_sheet, tile_sheet
from gmrdata.pages.fusion import plot_person
from gmrdata.pages.plots import (
    COLOURS,
    aligned_paths,
    drawn,
    picture,
    plot_predicted_view,
    plot_top_view,
    svg,
)
from gmrdata.pages.report import DPI, overview_plot, write_overview
from gmrdata.twins.pseudo_gt_error import compare_clips, error_series, paired_rows
from gmrdata.values import transforms
from gmrdata.values.camera import intrinsics_from_fov, project
from gmrdata.values.errors import BadFrames, NothingToCompare
from gmrdata.values.skinning import motion_vertices_m
from gmrdata.write import overlay
from tests.filming import write_pictures
from tests.motions import moved


def test_body_covers_the_painted_silhouette(report):
    clip = report.clips[0]
    camera = clip.true.camera
    assert camera is not None
    vertices_m = motion_vertices_m(clip.body, clip.true.motion, rows=np.array([3]))[0]
    black = np.zeros((camera.height_px, camera.width_px, 3), np.uint8)
    cam_from_world = transforms.invert(camera.world_from_cam[3])
    vertices_cam_m = transforms.apply(cam_from_world, vertices_m)
    drawn = overlay.draw_body(black, camera.intrinsics_px, vertices_cam_m, clip.body)
    assert clip.masks_dir is not None
    mask = cv2.imread(str(clip.masks_dir / "00003.png"), cv2.IMREAD_GRAYSCALE) > 0
    # The mask is dilated by 2 px, which also closes narrow gaps between the limbs.
    silhouette = cv2.erode(mask.astype(np.uint8), np.ones((7, 7))) > 0
    covered = drawn.sum(axis=2) > 0
    assert silhouette.sum() > 500
    assert not (covered & ~mask).any()
    assert (covered & silhouette).sum() > 0.98 * silhouette.sum()


def test_floor_path_is_drawn_where_the_camera_projects_it():
    intrinsics_px = intrinsics_from_fov(60.0, 320, 180)
    # Above the floor, looking straight down: OpenCV's z is the world's -z.
    world_from_cam = transforms.rigid(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, 4.0]))
    path_m = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    path_cam_m = transforms.apply(transforms.invert(world_from_cam), path_m)
    black = np.zeros((180, 320, 3), np.uint8)
    drawn = overlay.draw_floor_path(black, intrinsics_px, path_cam_m, every=5)
    ends_px = project(world_from_cam, path_m, intrinsics_px)
    rows, columns = np.nonzero(drawn.sum(axis=2) > 300)
    # Every fifth point carries a dot: of these two, the first.
    assert (rows.min() + rows.max() + 1) / 2 == pytest.approx(90.0, abs=0.6)
    assert columns.min() == pytest.approx(ends_px[0, 0] - 3 * overlay.LINE_PX, abs=1.1)
    assert columns.max() + 1 == pytest.approx(ends_px[1, 0], abs=2.0)


def test_points_behind_the_camera_are_not_drawn():
    image = np.full((180, 320, 3), 7, np.uint8)
    path_m = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, -2.0], [np.nan, 0.0, 1.0]])
    drawn = overlay.draw_floor_path(image, intrinsics_from_fov(60, 320, 180), path_m, 1)
    assert (drawn == image).all()


def test_tiles_are_evenly_spaced_from_the_first_frame_to_the_last(report):
    tiles = frame_tiles(report.clips[0], 4)
    assert [tile.image_number for tile in tiles] == [0, 4, 7, 11]
    assert [tile.time_s for tile in tiles] == pytest.approx([0.0, 0.4, 0.7, 1.1])
    assert len(frame_tiles(report.clips[0], 50)) == 12


def test_a_sheet_holds_the_tiles(report):
    def sheet_of_six() -> np.ndarray:
        return tile_sheet([tile.frame() for tile in frame_tiles(report.clips[0], 6)], columns=3)

    sheet = sheet_of_six()
    assert (sheet == sheet_of_six()).all()
    assert sheet.shape == (2 * 180 + 4, 3 * 320 + 8, 3)
    last = frame_tiles(report.clips[0], 6)[5].frame()
    assert (sheet[-180:, -320:] == last).all()


def test_close_ups_hold_the_person(report):
    clip = report.clips[0]
    tile = frame_tiles(clip, 1)[0]
    left, top, right, bottom = tile.person_px
    assert tile.drawn.shape == (360, 640, 3)
    assert 0 < left < right < 640 and 0 < top < bottom < 360
    assert clip.masks_dir is not None
    rows, columns = np.nonzero(cv2.imread(str(clip.masks_dir / "00000.png"), cv2.IMREAD_GRAYSCALE))
    mask_px = 2 * np.array([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1])
    # The mask is dilated by 2 px of the frame, 4 px here, and is drawn to whole pixels.
    np.testing.assert_allclose(tile.person_px, mask_px + np.array([4, 4, -4, -4]), atol=3)
    marked = replace(tile, drawn=np.zeros_like(tile.drawn))
    marked.drawn[int(top) : int(bottom), int(left) : int(right)] = 255
    close = marked.close_up(300, 380)
    assert close.shape == (380, 300, 3)
    tall = np.flatnonzero(close.max(axis=(1, 2)) > 127)
    assert len(tall) == pytest.approx(380 / 1.25, abs=3)
    assert close[0].max() == close[-1].max() == close[:, 0].max() == close[:, -1].max() == 0


def test_close_up_of_a_person_at_the_edge_stays_in_the_frame(report):
    tile = frame_tiles(report.clips[0], 1)[0]
    for box in ([-50, -20, 40, 200], [600, 250, 700, 500], [-500, -500, 2000, 2000]):
        close = replace(tile, person_px=np.array(box, dtype=float)).close_up(300, 380)
        assert close.shape == (380, 300, 3)


@pytest.mark.parametrize("fps_hz", [None, 10.0, 5.0])
def test_series_average_to_the_metrics(report, fps_hz):
    clip = report.clips[0]
    error = compare_clips(clip.pseudo, clip.true, fps_hz=fps_hz)
    series = error_series(clip.pseudo, clip.true, fps_hz=fps_hz)
    assert len(series.ome_deg) == len(series.motion_times_s) == (10 if fps_hz == 5.0 else 11)
    assert series.motion_times_s[0] == pytest.approx(0.1 if fps_hz == 5.0 else 0.05)
    assert series.ome_deg.mean() == pytest.approx(error.ome_deg, rel=1e-9)
    assert series.tme_mm.mean() == pytest.approx(error.tme_mm, rel=1e-9)
    assert series.camera_rotation_deg.mean() == pytest.approx(error.camera_rotation_deg, rel=1e-9)


def test_series_leave_gaps_open(report):
    clip = report.clips[0]
    valid = clip.pseudo.valid.copy()
    valid[4] = False
    series = error_series(replace(clip.pseudo, valid=valid), clip.true)
    assert np.flatnonzero(np.isnan(series.ome_deg)).tolist() == [3, 4]
    assert np.flatnonzero(np.isnan(series.tme_mm)).tolist() == [3, 4]
    assert np.flatnonzero(np.isnan(series.camera_rotation_deg)).tolist() == [4]


def test_series_agree_with_the_metrics_beside_a_gap(report):
    clip = report.clips[0]
    valid = clip.pseudo.valid.copy()
    valid[[4, 9]] = False
    pseudo = replace(clip.pseudo, valid=valid)
    error = compare_clips(pseudo, clip.true, fps_hz=5.0)
    series = error_series(pseudo, clip.true, fps_hz=5.0)
    assert np.flatnonzero(np.isfinite(series.ome_deg)).tolist() == [0, 1, 5, 6]
    assert np.nanmean(series.ome_deg) == pytest.approx(error.ome_deg, rel=1e-9)
    assert np.nanmean(series.tme_mm) == pytest.approx(error.tme_mm, rel=1e-9)


def test_rows_are_paired_by_image(report):
    true = report.clips[0].true
    later = replace(true, image_numbers=true.image_numbers + 3)
    rows, true_rows = paired_rows(later, true)
    assert (true_rows == np.arange(3, 12)).all()
    assert (rows == np.arange(9)).all()
    with pytest.raises(NothingToCompare, match="no image in common"):
        error_series(replace(true, image_numbers=true.image_numbers + 100), true)


def test_paths_are_moved_onto_the_true_world(report):
    clip = report.clips[0]
    pelvis_m, world_from_cam = aligned_paths(clip)
    assert world_from_cam is not None and clip.true.camera is not None
    # The clip's cameras were shaken by 3 mm and 0.05 degrees a frame, seen from some metres.
    assert np.abs(pelvis_m - clip.true.motion.pelvis_m).max() < 0.05
    offsets_m = world_from_cam[:, :3, 3] - clip.true.camera.centres_world_m
    assert np.abs(offsets_m).max() < 0.02


def test_top_view_has_equal_axes_and_both_paths(report):
    clip = report.clips[0]
    axes = Figure().subplots()
    plot_top_view(axes, clip)
    assert axes.get_aspect() == 1.0
    lines = {(line.get_color(), line.get_linewidth()): line for line in axes.get_lines()}
    true_line = lines[COLOURS["person-pale"], 6.0]
    assert (true_line.get_xydata() == clip.true.motion.pelvis_m[:, :2]).all()
    assert (COLOURS["camera-pale"], 6.0) in lines
    assert (COLOURS["camera"], 1.6) in lines
    assert {text.get_text() for text in axes.texts} == {"person", "camera"}


def test_predicted_motion_starts_at_the_true_start(report):
    true = report.clips[0].true.motion
    turned = transforms.rigid(
        Rotation.from_euler("z", 70.0, degrees=True).as_matrix(), np.array([5.0, 4.0, 0.0])
    )
    axes = Figure().subplots()
    plot_predicted_view(axes, true, moved(true, turned))
    (line,) = (
        line
        for line in axes.get_lines()
        if line.get_color() == COLOURS["gmr"] and line.get_linewidth() == 1.6
    )
    np.testing.assert_allclose(line.get_xydata(), true.pelvis_m[:, :2], atol=1e-12)


def test_plots_follow_the_readers_colour_scheme(report):
    def draw(figure: Figure) -> None:
        plot_top_view(figure.subplots(), report.clips[0])

    plot = svg(draw, 4.0, 4.0, "paths")
    assert plot == svg(draw, 4.0, 4.0, "paths")
    assert "var(--person)" in plot and "var(--camera-pale)" in plot
    assert not any(colour in plot for colour in COLOURS.values())
    style = Path(__file__).parents[2] / "gmrdata" / "pages" / "templates" / "style.css"
    defined = style.read_text()
    # Once for light, which print takes too, and once for dark screens alone.
    light, dark, *_ = defined.split("@media")
    assert dark.startswith(" screen and (prefers-color-scheme: dark)")
    assert all(f"--{role}:" in light and f"--{role}:" in dark for role in COLOURS)


def test_names_in_chinese_take_a_font_of_the_system_that_has_them(tmp_path, monkeypatch):
    """Pictures had boxes in their place."""
    monkeypatch.setattr(fontManager, "ttflist", fontManager.ttflist.copy())
    font = TTFont(findfont("DejaVu Sans"))
    for table in font["cmap"].tables:
        table.cmap = {ord("人"): "A"}
    for record in font["name"].names:
        record.string = "Noto Sans CJK JP"
    font.save(tmp_path / "noto.ttf")
    fontManager.addfont(tmp_path / "noto.ttf")
    assert picture_of("人") == picture_of("A") != picture_of("B")


def picture_of(title: str) -> bytes:
    return picture(lambda figure: figure.suptitle(title), 1.0, 1.0)


def test_ids_of_a_drawing_hang_on_its_name_alone_and_its_texts_stay_whole():
    def draw_at(width: float) -> str:
        def draw(figure: Figure) -> None:
            figure.set_layout_engine("none")
            axes = figure.add_axes((0.1, 0.1, width, 0.8))
            axes.plot([0, 1 / 3, 1], [0, 2 / 7, 1], "o-")
            axes.set_title("0.012345 m")

        return svg(draw, 4.0, 4.0, "some")

    # The solver of a layout leaves the last bit of coordinates to chance, and ids came from them.
    drawn = draw_at(0.8)
    assert drawn == draw_at(np.nextafter(0.8, 1.0))
    ids = re.findall(r' id="([^"]*)"', drawn)
    assert ids == [f"some-{number}" for number in range(len(ids))] and len(ids) >= 2
    used = re.findall(r'(?:url\(#|href="#)([^)"]*)', drawn)
    assert set(used) == set(ids)
    assert ">0.012345 m<" in drawn
    assert not re.search(r' d="[^"]*\.[0-9]{3}', drawn)


def test_texts_of_the_overview_stand_clear_of_each_other(report):
    draw, size_in = overview_plot(report, 5)
    width_px, height_px = DPI * np.array(size_in)
    assert width_px > 2000 and width_px > 2 * height_px
    plot = drawn(draw, *size_in, DPI)
    plot.draw_without_rendering()
    texts = [text for text in plot.findobj(Text) if text.get_visible() and text.get_text().strip()]
    assert sum(text.get_text() == "camera" for text in texts) == 3
    for one, other in combinations(texts, 2):
        boxes = one.get_window_extent(), other.get_window_extent()
        assert not boxes[0].overlaps(boxes[1]), (one.get_text(), other.get_text())


def test_overview_is_reproducible_and_wide(report, tmp_path):
    # One row is enough for this; the test before draws all three.
    report = replace(report, clips=report.clips[:1])
    first = write_overview(tmp_path / "a.png", report).read_bytes()
    assert write_overview(tmp_path / "b.png", report).read_bytes() == first
    picture = cv2.imread(str(tmp_path / "a.png"))
    assert picture.shape[1] > 2000
    assert picture.shape[1] > 2 * picture.shape[0]
    assert picture[0, 0].tolist() == [255, 255, 255]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.png", "b.png"]


@pytest.fixture
def grey_dirs(tmp_path) -> tuple[Path, Path]:
    """Six grey frames of 80x40 with the left half masked."""
    mask = np.zeros((40, 80), np.uint8)
    mask[:, :40] = 255
    write_pictures(tmp_path / "frames", [np.full((40, 80, 3), 100, np.uint8)] * 6)
    write_pictures(tmp_path / "masks", [mask] * 6)
    return tmp_path / "frames", tmp_path / "masks"


def test_the_masked_part_is_tinted_and_the_rest_left(grey_dirs):
    sheet = mask_sheet(*grey_dirs, n_frames=5, tile_width_px=80)
    assert sheet.shape == (2 * 40 + 4, 4 * 80 + 3 * 4, 3)  # four to a row, 4 px apart
    expected = np.round(0.65 * 100 + 0.35 * np.array(TINT_BGR))
    np.testing.assert_array_equal(sheet[20, 20], expected)
    np.testing.assert_array_equal(sheet[20, 60], [100, 100, 100])
    assert sheet[20, 39].min() > 200  # the outline
    np.testing.assert_array_equal(sheet[50:70, 100:], np.full((20, 232, 3), 255))


def test_it_is_made_anew_when_masks_change(grey_dirs, tmp_path):
    first = make_mask_sheet(*grey_dirs, tmp_path / "sheet").read_bytes()
    cv2.imwrite(str(grey_dirs[1] / "00000.png"), np.zeros((40, 80), np.uint8))
    assert make_mask_sheet(*grey_dirs, tmp_path / "sheet").read_bytes() != first


def test_a_missing_mask_is_an_error(grey_dirs, tmp_path):
    (grey_dirs[1] / "00005.png").unlink()
    with pytest.raises(BadFrames, match=r"no mask for 00005\.png"):
        make_mask_sheet(*grey_dirs, tmp_path / "sheet")


def test_gaps_lie_on_grey_behind_the_error_bars(walkers):
    clip = walkers[0]
    n_frames, fps_hz = clip.motion.n_frames, clip.motion.fps_hz
    has_camera = np.ones(n_frames, dtype=bool)
    has_camera[[4, 7, 8]] = False
    sigma = {
        "place_sigma_m": np.tile([0.1, 0.2, 0.2], (n_frames, 1)),
        "turn_sigma_deg": np.full((n_frames, 3), 5.0),
        "has_camera": has_camera,
    }
    plot = Figure()
    plot_person(plot, clip, sigma)
    *places, place, turn = plot.axes
    assert [axes.get_ylabel() for axes in places] == ["x [m]", "y [m]", "z [m]"]
    for axis, axes in enumerate(places):
        (line,), (band,) = axes.get_lines(), axes.collections
        np.testing.assert_array_equal(line.get_ydata(), clip.motion.pelvis_m[:, axis])
        heights = band.get_paths()[0].vertices[:, 1]
        reach_m = 2 * sigma["place_sigma_m"][0, axis]
        assert np.isclose(heights.min(), clip.motion.pelvis_m[:, axis].min() - reach_m)
        assert all(patch.get_zorder() < band.get_zorder() for patch in axes.patches)
    np.testing.assert_allclose(place.get_lines()[0].get_ydata(), np.sqrt(0.09 / 3))
    np.testing.assert_allclose(turn.get_lines()[0].get_ydata(), 5.0)
    for axes in plot.axes:
        spans = [
            patch.get_path().transformed(patch.get_patch_transform()) for patch in axes.patches
        ]
        ends_s = [(span.vertices[:, 0].min(), span.vertices[:, 0].max()) for span in spans]
        np.testing.assert_allclose(np.array(ends_s) * fps_hz, [(3.5, 4.5), (6.5, 8.5)])
