"""The page of a solved video says what was decided and found, and leads to files that are there."""

import shutil
from dataclasses import replace
from pathlib import Path

import av
import numpy as np
import pytest
from matplotlib.figure import Figure

from gmrdata.cameras.files import load_quality
from gmrdata.cameras.lens.intrinsics import Intrinsics
from gmrdata.pages import solved_page
from gmrdata.pages.footage import BAR_PX, Footage, footage_of
from gmrdata.pages.fusion import plot_person
from gmrdata.pages.gather import gather_video
from gmrdata.pages.solved_page import make_overlay, make_video_page
from gmrdata.pages.thresholds import frame_rows, verdict_rows
from gmrdata.pages.view3d import view_of
from gmrdata.solve.verdict import VERDICT_FILE, VideoVerdict, unsolved
from gmrdata.values.clip import load_clip, save_clip
from gmrdata.values.errors import MissingInput
from gmrdata.values.files import read_npz, write_npz
from gmrdata.world.bodies import NOT_SEEN
from gmrdata.world.judge import load_record
from gmrdata.world.picture_fit import PictureFit
from gmrdata.world.recipe import Doubts, PseudoGtConfig, VerdictConfig, verdict_of
from tests.pages.html_pages import Page
from tests.pages.solved_video import N_ROWS, OFF_PX, camera_verdict, fuse_video, solved_video

HOSTILE = "<img src=x onerror='alert(1)'> \"#?%20&amp; caf\udce9"


@pytest.fixture
def copied(finished, tmp_path) -> Path:
    return Path(shutil.copytree(finished, tmp_path / "walk"))


def leads_to_files(page: Page) -> None:
    """Every link is relative, stays in the folder and leads to a file."""
    assert "script" not in page.tags
    outside = [link for link in page.links if not link.startswith(("data:", "#"))]
    assert not [link for link in outside if ":" in link or link.startswith("/")]
    for file in page.files:
        assert file.is_file() and file.is_relative_to(page.path.parent), file


def drawn(folder: Path) -> Page:
    """The page, made now."""
    page = Page(make_video_page(folder))
    leads_to_files(page)
    return page


def test_the_page_has_all_parts_and_leads_to_files(finished):
    page = Page(finished / "index.html")
    leads_to_files(page)
    assert "can’t be" not in page.words and "Can’t be" not in page.words
    assert page.tags.count("video") == 1 and page.tags.count("svg") == 4
    assert f"Person 0: accepted, {N_ROWS} of {N_ROWS} frames (100.0%)" in page.words
    assert f"640×360 px, {N_ROWS} frames, 2.3 s, one person, circular camera" in page.words
    record = load_record(finished / "pseudo_gt")
    assert record.scale is not None and record.scale_sigma is not None
    assert f"fused{record.scale:.5g}" in page.words
    assert (
        f"two standard errors of the metric scale ({200 * record.scale_sigma / record.scale:.1f}"
        in page.words
    )
    assert "Focal length554.3 px" in page.words and "60.0° by 36.0°" in page.words
    assert "Mean reprojection error per frame [px]" in page.words
    for name in ("overlay.mp4", "poster.jpg", "person_0.npz", "quality.json", "stage.json"):
        assert name in {file.name for file in page.files}


def test_the_overlay_has_every_frame(finished):
    with av.open(str(finished / "overlay" / "overlay.mp4")) as container:
        frames = list(container.decode(video=0))
        assert container.streams.video[0].average_rate == 10
    assert len(frames) == N_ROWS
    assert (frames[0].width, frames[0].height) == (640, 360 + BAR_PX)


def test_the_errors_are_those_of_the_observations(finished):
    from gmrdata.pages.gather import Reader, read_reconstruction

    found = read_reconstruction(Reader(), finished / "sfm")
    assert found is not None and found.errors_px.shape == (N_ROWS,)
    assert found.errors_px == pytest.approx(OFF_PX, abs=0.01)


def test_a_folder_that_was_moved_still_has_its_page(copied, tmp_path):
    moved = tmp_path / "elsewhere"
    copied.rename(moved)
    leads_to_files(Page(moved / "index.html"))


def test_what_is_there_is_kept_and_what_changed_is_drawn_again(copied):
    overlay = copied / "overlay" / "overlay.mp4"
    before, page = overlay.stat().st_mtime_ns, (copied / "index.html").read_bytes()
    make_video_page(copied)
    assert overlay.stat().st_mtime_ns == before
    # Only the folder's name, which is the title, differs.
    assert (copied / "index.html").read_bytes() == page.replace(b"finished_video", b"walk")
    shutil.copy(copied / "masks" / "00100.png", copied / "masks" / "00101.png")
    make_video_page(copied)
    assert overlay.stat().st_mtime_ns > before


def test_the_overlay_follows_the_bodies_and_the_verdict(copied, tmp_path):
    overlay = copied / "overlay" / "overlay.mp4"
    with_body = overlay.read_bytes()
    body = (copied / "body").rename(tmp_path / "elsewhere") / "body.npz"
    make_video_page(copied)
    assert overlay.read_bytes() != with_body
    make_video_page(copied, body=str(body))
    assert overlay.read_bytes() == with_body
    shutil.rmtree(copied / "pseudo_gt")  # cameras alone, of which verdict.json says what is kept
    kept = []
    for reason in ("", "too fast"):
        camera_verdict(reason).write(copied / VERDICT_FILE)
        make_video_page(copied)
        kept.append(overlay.read_bytes())
    assert kept[0] != kept[1]


def test_hostile_names_and_reasons_stay_texts(copied):
    folder = copied.rename(copied.with_name(HOSTILE))
    said = HOSTILE.encode("utf-8", "replace").decode()  # records hold whole characters alone
    person = verdict_of(said, False, (f"because {said}",), [said] * N_ROWS)
    path = folder / "pseudo_gt" / "quality.json"
    load_record(folder / "pseudo_gt").model_copy(update={"people": (person,)}).write(path)
    (folder / "files" / "bvh").mkdir(parents=True)
    (folder / "files" / "bvh" / f"{HOSTILE}.bvh").write_text("HIERARCHY")
    page = drawn(folder)
    assert {"img", "b", "i"}.isdisjoint(page.tags) and "onerror" not in page.attributes
    shown = HOSTILE.encode("utf-8", "backslashreplace").decode()
    assert page.words.startswith(shown) and f"because {said}" in page.words
    assert f"{HOSTILE}.bvh" in {file.name for file in page.files}


def test_a_rejected_video_says_so_first_and_warns_of_its_files(small_body, tmp_path):
    config = PseudoGtConfig(verdict=VerdictConfig(min_inliers=101))
    solved_video(tmp_path / "walk", small_body, lost=[9, 10], config=config)
    page = drawn(tmp_path / "walk")
    verdict = page.words.index(f"Person 0: rejected, 0 of {N_ROWS} frames")
    assert verdict < page.words.index("Over the frames", page.words.index("Verdict"))
    assert "✗≥ 50" in page.words
    assert "fewer than 101 inliers" in page.words and "no camera was found" in page.words
    assert "these files are for looking, not for use" in page.words
    assert "frames within the thresholds, but rejected" in page.words


def test_frames_of_a_rejected_person_are_not_kept_beside_an_accepted_one(copied):
    """The bar below the picture said that they are, and lines of files break off there."""
    found = gather_video(copied)
    first, second = 12 * [""] + (N_ROWS - 12) * ["the camera jumps"], N_ROWS * [""]
    people = verdict_of("walk", True, (), first), verdict_of("it", False, ("it floats",), second)
    assert found.record is not None
    record = found.record.model_copy(update={"people": people, "picture_fits": (None, None)})
    both = replace(found, record=record, reasons=(tuple(first), tuple(second)))
    assert footage_of(both).dropped.tolist() == 12 * [False] + (N_ROWS - 12) * [True]
    said = "Rejected: person 1. Files of those are for looking, not for use."
    for shown, is_said in ((both, True), (found, False)):
        html = solved_page.solved_page(shown, copied / "index.html")
        assert (said in html, "for looking" in html) == (is_said, is_said)


def test_one_who_comes_late_is_accepted_by_the_frames_that_show_them(small_body, tmp_path):
    """A page had 33 % of 24 valid frames, and said that they miss the 50 % of the verdict."""
    doubts = Doubts(frames=((NOT_SEEN,) * 16 + ("",) * 8,), sequence=())
    solved_video(tmp_path / "walk", small_body, doubts=doubts)
    found = gather_video(tmp_path / "walk")
    assert found.accepted == [True] and found.record is not None
    said = {row.name: row[1:] for row in verdict_rows(found)}
    assert said["the 8 valid frames of person 0 that are left [%]"] == ("100.0", "≥ 50", True)
    # Beside the person wherever it is laid: 9 of 100 are no error of time, as the verdict has it.
    fit = PictureFit(8, 2, 0.30, 3, 0.39, 5, (2, 3))
    seen = replace(found, record=found.record.model_copy(update={"picture_fits": (fit,)}))
    said = {row.name: row[1:] for row in verdict_rows(seen)}
    gains = "overlap that the body of person 0 gains on other frames"
    assert said[gains] == ("0.09", "≤ 0.08, or < 0.5 there", True)
    other = "compared frames in which another body lies where that of person 0 does [%]"
    assert said[other] == ("62.5", "≤ 50", False)


def test_an_interpolated_camera_without_inliers_is_beyond_no_threshold(copied):
    """Its frame is kept, and was counted among those that are dropped."""
    found = gather_video(copied)
    record, fewest = found.record, frame_rows(found)[0]
    assert record is not None and record.cameras is not None and fewest.met
    counts = (0, *record.cameras.inliers_per_frame[1:])
    between = {"inliers_per_frame": counts, "interpolated": (0,)}
    cameras = record.cameras.model_copy(update=between)
    seen = replace(found, record=record.model_copy(update={"cameras": cameras}))
    assert frame_rows(seen)[0] == fewest


def test_people_with_the_network_s_motions_are_shown_in_all_frames(small_body, run_dir, tmp_path):
    folder = tmp_path / "walk"
    solved_video(folder, small_body, lost=[9, 10, 11])
    fuse_video(folder, run_dir)
    page = drawn(folder)
    said = "is the fused one (fused): camera poses put together with the motions of GMR “run”"
    assert said in page.words and "is the pseudo ground truth" not in page.words
    assert "In the 3 frames without a camera the motion goes on" in page.words
    assert "no camera pose for 0.30 s from 0.90 s on" in page.words
    assert "dotted where the frame is dropped and the network fills in" in page.words
    assert page.tags.count("svg") == 5
    names = {str(file.relative_to(folder)) for file in page.files}
    for name in ("fused/person_0.npz", "fused/sigma_0.npz", "pseudo_gt/person_0.npz"):
        assert name in names
    assert {"fused/stage.json", "fused/fusion.json"} <= names
    found = gather_video(folder, None, None)
    fused = load_clip(folder / "fused" / "person_0.npz").motion
    np.testing.assert_array_equal(found.clips[0].motion.pelvis_m, fused.pelvis_m)
    (person,) = footage_of(found).people
    assert person.shown.all()
    np.testing.assert_array_equal(person.motion.pelvis_m, fused.pelvis_m)
    with av.open(str(folder / "overlay" / "poster.jpg")) as container:
        poster = next(container.decode(video=0)).to_ndarray(format="rgb24").astype(int)
    assert (poster[..., 2] - poster[..., 0] > 60).sum() > 500  # the body: its row has a camera


def test_nobody_is_shown_in_the_film_s_other_minutes(small_body, run_dir, tmp_path):
    """A person who was seen for some seconds stood in the 3D view, and had a path without an error
    bar, throughout; and one without any usable frame stood at the origin of the others' world."""
    folder = tmp_path / "walk"
    solved_video(folder, small_body, lost=[9, 10, 11])
    fused = fuse_video(folder, run_dir)
    sigmas = read_npz(fused / "sigma_0.npz")
    for key in ("place_sigma_m", "camera_sigma_m", "turn_sigma_deg"):
        sigmas[key][:5] = np.nan
    sigmas["has_camera"][:5] = False
    write_npz(fused / "sigma_0.npz", sigmas)
    clip = load_clip(fused / "person_0.npz")
    rest_pelvis_m = small_body.rest_pelvis_m(clip.motion.shape)
    save_clip(fused / "person_0.npz", replace(clip, valid=np.arange(N_ROWS) >= 5), rest_pelvis_m)
    found = gather_video(folder)
    (shown,) = view_of(found).people
    known = np.isfinite(shown.clip.motion.pelvis_m).all(axis=1)
    assert np.flatnonzero(known).tolist() == list(range(5, N_ROWS))
    assert np.flatnonzero(shown.clip.valid).tolist() == [*range(5, 9), *range(12, N_ROWS)]
    (person,) = found.people
    assert person.clip.motion is found.clips[0].motion and person.clip.valid[9]
    plot = Figure()
    plot_person(plot, clip, sigmas)
    x_place, *_ = plot.axes
    assert x_place.get_xlim() == pytest.approx((0.45, 2.35))
    assert np.isnan(x_place.lines[0].get_ydata()[:5]).all()
    nowhere = replace(clip, valid=np.zeros(N_ROWS, dtype=bool))
    save_clip(fused / "person_0.npz", nowhere, rest_pelvis_m)
    assert not np.isfinite(gather_video(folder).clips[0].motion.pelvis_m).any()
    assert "In 3D" in drawn(folder).words


def test_a_person_of_another_system_who_left_does_not_follow_the_camera(copied):
    path = copied / "pseudo_gt" / "quality.json"
    record = load_record(copied / "pseudo_gt")
    reasons = [NOT_SEEN] * 6 + [""] * 8 + [NOT_SEEN] * 2 + [""] * 2 + [NOT_SEEN] * 6
    people = (verdict_of("walk", True, (), reasons),)
    record.model_copy(update={"people": people}).write(path)
    known = np.isfinite(gather_video(copied).clips[0].motion.pelvis_m).all(axis=1)
    assert np.flatnonzero(known).tolist() == list(range(6, 18))


def test_cameras_alone_of_images_are_shown_at_their_rate(small_body, tmp_path):
    folder = tmp_path / "walk"
    solved_video(folder, small_body, person=False)
    camera_verdict().write(folder / VERDICT_FILE)
    np.testing.assert_allclose(np.diff(gather_video(folder).times_s), 0.1)


def test_the_overlay_is_made_again_at_another_rate(small_body, tmp_path, monkeypatch):
    drawn_hz: list[float] = []

    def draw(path: Path, footage: Footage) -> None:
        drawn_hz.append(footage.fps_hz)
        path.touch()

    monkeypatch.setattr(solved_page, "write_footage", draw)
    folder = tmp_path / "walk"
    solved_video(folder, small_body, person=False)
    for rate_hz in (10.0, 20.0, 20.0):
        camera_verdict().model_copy(update={"fps_hz": rate_hz}).write(folder / VERDICT_FILE)
        found = gather_video(folder)
        make_overlay(found, footage_of(found))
    assert drawn_hz == pytest.approx([10.0, 20.0])


def test_the_network_s_motions_come_and_go(copied, run_dir):
    overlay = copied / "overlay" / "overlay.mp4"
    make_video_page(copied)
    before, drawn = (copied / "index.html").read_bytes(), overlay.read_bytes()
    assert "is the pseudo ground truth (pseudo_gt)" in Page(copied / "index.html").words
    fused = fuse_video(copied, run_dir)
    make_video_page(copied)
    assert overlay.read_bytes() != drawn
    assert "frames without a camera" not in Page(copied / "index.html").words.split("Paths")[1]
    (fused / "sigma_0.npz").unlink()
    words = Page(make_video_page(copied)).words
    assert (
        "is the pseudo ground truth" in words and "sigma_0.npz" in words.split("Can’t be read")[1]
    )
    shutil.rmtree(fused)
    make_video_page(copied)
    assert (copied / "index.html").read_bytes() == before and overlay.read_bytes() == drawn


def test_the_network_s_motions_of_other_frames_are_not_shown(copied, run_dir, small_body):
    fused = fuse_video(copied, run_dir)
    clip = load_clip(fused / "person_0.npz")
    other = replace(clip, image_numbers=clip.image_numbers + 1)
    save_clip(fused / "person_0.npz", other, small_body.rest_pelvis_m(clip.motion.shape))
    words = Page(make_video_page(copied)).words
    assert "is the pseudo ground truth" in words
    assert "is of other people or frames than pseudo_gt" in words.split("Can’t be read")[1]
    sigma = read_npz(fused / "sigma_0.npz")
    cut = {key: value[1:] if value.ndim else value for key, value in sigma.items()}
    write_npz(fused / "sigma_0.npz", cut)
    words = Page(make_video_page(copied)).words
    assert "sigma_0.npz: is of other frames" in words.split("Can’t be read")[1]


def guessed(focal_sigma: float) -> Intrinsics:
    """A lens that nobody measured."""
    return Intrinsics(
        source="prior", width_px=640, height_px=360, focal_px=554.3, focal_y_px=554.3,
        focal_sigma=focal_sigma, centre_px=(320.0, 180.0),
        radial_k1=-0.1, radial_k1_sigma=0.02, radial_k2=0.0,
        focal_observable=False, asked=None, asked_by_lines=None, starts=(),
        objections=("the <b>lens</b> is not of these frames",), notes=("a guess",),
    )  # fmt: skip


def test_cameras_alone_are_beside_the_thresholds_that_their_lens_allows(small_body, tmp_path):
    """Their verdict allows two standard errors of the focal length, and 1.1 times it was accepted;
    the page had 1 %, and said that the accepted cameras did not meet it."""
    folder = tmp_path / "walk"
    solved_video(folder, small_body, person=False)
    measured = {"focal_factor": 1.1, "focal_sigma": 0.01}
    load_quality(folder / "sfm").model_copy(update=measured).write(folder / "sfm" / "quality.json")
    refused = gather_video(folder)
    assert refused.camera_verdict is not None and not refused.camera_verdict.accepted
    guessed(0.12).write(folder / "intrinsics" / "intrinsics.json")
    found = gather_video(folder)
    assert found.camera_verdict is not None and found.camera_verdict.accepted
    row = verdict_rows(found)[-1]
    assert row[1:] == ("1.100 ± 0.010", "1 ± 0.24, beyond it by 2 standard errors", True)


def test_the_lens_comes_with_its_source_and_its_error(copied):
    guessed(0.3).write(copied / "intrinsics" / "intrinsics.json")
    page = drawn(copied)
    assert (
        "Focal length554.3 px ± 30 %" in page.words
        and "a guess: neither the file nor" in page.words
    )
    assert "Radial distortion k1-0.1 ± 0.02" in page.words
    assert "the <b>lens</b> is not of these frames" in page.words and "b" not in page.tags
    assert "intrinsics: intrinsics.json" in page.words


def test_a_lens_that_bends_by_its_second_term_alone_is_shown(copied):
    bent = {"source": "given", "radial_k1": 0.0, "radial_k1_sigma": None, "radial_k2": 0.25}
    guessed(0.01).model_copy(update=bent).write(copied / "intrinsics" / "intrinsics.json")
    assert "Radial distortion k10, k2 0.25" in drawn(copied).words


def test_cameras_alone(small_body, tmp_path):
    solved_video(tmp_path / "walk", small_body, person=False, lost=[5, 6, 7])
    page = drawn(tmp_path / "walk")
    assert f"Cameras: accepted, 21 of {N_ROWS} frames (87.5%)" in page.words
    assert "cameras alone" in page.words and "background points" in page.words
    assert "[units of the reconstruction]" in page.words and "Metric scale" not in page.words
    assert "camera5 to 73no camera was found" in page.words
    assert page.tags.count("svg") == 3 and page.tags.count("video") == 1


def test_a_camera_that_turns_alone(small_body, tmp_path):
    solved_video(tmp_path / "walk", small_body, "rotation_only", person=False)
    page = Page(make_video_page(tmp_path / "walk"))
    assert "a grid of directions, 10° apart" in page.words
    assert "Mean reprojection error per frame" not in page.words


def test_the_verdict_of_a_video_without_cameras(tmp_path):
    camera = unsolved("no two frames show the same place", 30)
    VideoVerdict(
        images_dir="frames", fps_hz=30.0, accepted=False, reasons=camera.reasons, camera=camera,
        people=(), notes=("the poses are of every second frame",),
    ).write(tmp_path / VERDICT_FILE)  # fmt: skip
    page = drawn(tmp_path)
    assert "Cameras: rejected, 0 of 30 frames" in page.words
    assert "no two frames show the same place" in page.words
    assert "the poses are of every second frame" in page.words
    assert "no camera was found, so nothing has a place in the frames" in page.words


def test_what_is_missing_is_named_and_costs_its_part_alone(copied, tmp_path):
    shutil.rmtree(copied / "frames")
    (copied / "sfm" / "tracks.npz").unlink()
    page = drawn(copied)
    assert "can’t be shown: the frames are not here: give their folder with --images" in page.words
    assert "tracks.npz: an older gmrdata kept no tracks" in page.words
    assert "Person 0: accepted" in page.words and page.tags.count("svg") == 4
    shutil.rmtree(copied / "body")
    (copied / "pseudo_gt" / "quality.json").write_text("{")
    page = Page(make_video_page(copied))
    assert "quality.json" in page.words.split("Can’t be read")[1]
    assert "No verdict" in page.words and ": accepted" not in page.words
    with pytest.raises(MissingInput, match="nothing of a video was solved there"):
        make_video_page(tmp_path)


def test_where_nobody_s_motion_can_be_read_the_verdict_is_said_still(copied):
    """The cameras' own path stood for the people's, in other units, and there was no page."""
    (copied / "pseudo_gt" / "person_0.npz").unlink()
    page = drawn(copied)
    assert "Person 0: accepted" in page.words and "The world motions can’t be read" in page.words
    assert "no person's motion can be read, so nothing has a place in the frames" in page.words
    assert "person_0.npz" in page.words.split("Can’t be read")[-1]


@pytest.mark.parametrize("first_rows", [slice(10), slice(0)])
def test_files_of_other_frames_are_named_and_not_drawn(copied, first_rows):
    """A person's file beside another's record, or a camera without a size, cost the whole page."""
    path = copied / "pseudo_gt" / "person_0.npz"
    arrays = read_npz(path)
    if first_rows.stop:
        per_row = ("poses", "trans", "valid", "image_numbers", "world_from_cam", "has_camera")
        arrays |= {key: arrays[key][first_rows] for key in per_row}
    else:
        arrays["camera_size_px"] = np.zeros(2, np.int64)
    write_npz(path, arrays)
    page = drawn(copied)
    assert "The world motions can’t be read" in page.words
    why = f"is of 10 frames, not {N_ROWS}" if first_rows.stop else "not above zero"
    assert why in page.words.split("Can’t be read")[1]


def test_a_verdict_on_other_cameras_is_none(small_body, tmp_path):
    folder = tmp_path / "walk"
    solved_video(folder, small_body, person=False)
    camera = verdict_of("camera", True, (), [""] * 5)
    camera_verdict().model_copy(update={"camera": camera}).write(folder / VERDICT_FILE)
    page = drawn(folder)
    assert "No verdict" in page.words
    assert f"is of 5 frames, not {N_ROWS}" in page.words.split("Can’t be read")[1]


def test_people_of_one_record_have_the_same_frames(copied):
    people = tuple(verdict_of("walk", True, (), [""] * n) for n in (N_ROWS, 10))
    record = load_record(copied / "pseudo_gt")
    twice = {"people": people, "picture_fits": (None, None), "distance_sigmas": (0.0, 0.0)}
    record.model_copy(update=twice).write(copied / "pseudo_gt" / "quality.json")
    said = drawn(copied).words.split("Can’t be read")[1]
    assert "quality.json: `the record` is wrong" in said and "not of the same frames" in said


@pytest.mark.parametrize("scale", [0.0, -0.5])
def test_a_scale_that_no_camera_has_is_shown_without_a_plot(copied, scale):
    """The verdict refuses such a scale, and the page of what it refused was not written."""
    path = copied / "pseudo_gt" / "quality.json"
    record = load_record(copied / "pseudo_gt")
    record.model_copy(update={"scale": scale}).write(path)
    words = drawn(copied).words.split("Metric scale")[-1]
    assert f"fused{scale:.5g}–" in words and "Each cue with one" not in words


def test_without_the_body_the_path_is_not_drawn_and_it_is_said(copied):
    shutil.rmtree(copied / "body")
    page = Page(make_video_page(copied))
    assert "needs the body small" in page.words.split("Can’t be read")[1]
    assert page.tags.count("video") == 1 and "the body in the frames" not in page.words


def test_links_out_of_the_folder_are_not_followed(copied, tmp_path):
    secret = tmp_path / "secret.jpg"
    shutil.move(copied / "frames" / "00110.jpg", secret)
    (copied / "frames" / "00110.jpg").symlink_to(secret)
    (copied / "files" / "bvh").mkdir(parents=True)
    (copied / "files" / "bvh" / "a.bvh").symlink_to(secret)
    (copied / "frames" / "00105.jpg").unlink()  # which cost the overlay, as if none was there
    page = Page(make_video_page(copied))
    said = page.words.split("Can’t be read")[1]
    assert "1 images are links out of it" in said and "frames: no image of number 105" in said
    assert page.tags.count("video") == 1
    assert not [file for file in page.files if file.name in ("a.bvh", "secret.jpg")]


def test_a_browser_shows_it_without_the_net(finished, browse):
    seen = browse(finished / "index.html")
    assert (seen.complaints, seen.requests) == ([], [])
