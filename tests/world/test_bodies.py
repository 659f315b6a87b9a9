"""The rows of another system's file on the images of a video."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gmrdata.film.programmes import Circular, camera_path
from gmrdata.motion.gait import make_gait
from gmrdata.read.body_file import save_body
from gmrdata.stage.run import Run
from gmrdata.values.body import JOINT, BodyModel
from gmrdata.values.camera import CameraPath, Lens
from gmrdata.values.clip import load_clip
from gmrdata.values.errors import BadMotionFile, BadRecipe
from gmrdata.values.frame_set import Filmed, FrameSet
from gmrdata.world.bodies import BodiesConfig, BodiesRecord, make_bodies
from gmrdata.world.size import heights_of
from tests.frame_sets import frame_set
from tests.read import system_files
from tests.read.system_files import Seen

N_FRAMES, SIZE_PX = 24, (640, 360)


@pytest.fixture(scope="module")
def seen(neutral) -> Seen:
    motion = make_gait("walk", N_FRAMES / 10, 10.0, neutral, np.random.default_rng(2))
    motion = replace(motion.take(slice(0, N_FRAMES)), body=neutral.name)
    rng = np.random.default_rng(0)
    path = camera_path(Circular(radius_m=3.0), motion.pelvis_m, 10.0, *SIZE_PX, 60.0, rng)
    return system_files.seen_person(motion, path, neutral)


def rows_of(seen: Seen, rows: np.ndarray, frames: np.ndarray) -> Seen:
    """Some of the frames, under other numbers."""
    return replace(
        seen,
        motion=seen.motion.take(rows),
        offsets_m=seen.offsets_m[rows],
        joints_px=seen.joints_px[rows],
        frames=frames,
    )


def video(frames: np.ndarray, n_frames: int | None = N_FRAMES, fps_hz: float = 10.0) -> FrameSet:
    return frame_set(frames, SIZE_PX, fps_hz, n_frames)


ALL = np.arange(N_FRAMES)


def filmed(seen: Seen, frames: FrameSet | None = None) -> Filmed:
    """By the person's own lens; the whole video unless said."""
    return Filmed(frames or video(ALL), Lens.of_matrix(seen.intrinsics_px, SIZE_PX))


def made(
    folder: Path,
    people: list[Seen],
    frames: FrameSet,
    body: BodyModel,
    config: BodiesConfig | None = None,
) -> BodiesRecord:
    path = system_files.write_joblib(folder / "wham_output.pkl", system_files.wham_people(people))
    return made_of(path, filmed(people[0], frames), body, config)


def made_of(
    path: Path, filmed: Filmed, body: BodyModel, config: BodiesConfig | None = None
) -> BodiesRecord:
    """Of a system's file, beside it."""
    body_path, out = path.with_name("body.npz"), path.with_name("bodies")
    save_body(body_path, body)
    config = BodiesConfig() if config is None else config
    files = make_bodies(path, filmed, body_path, out, config)
    record = BodiesRecord.read(out / "bodies.json")
    assert len(files) == len(record.people)
    return record


def test_every_image_has_a_row_and_gaps_are_filled_but_not_valid(seen, neutral, tmp_path):
    known = np.r_[2:9, 12:N_FRAMES]
    record = made(tmp_path, [rows_of(seen, known, known)], video(ALL), neutral)
    clip = load_clip(tmp_path / "bodies" / "person_0.npz")
    np.testing.assert_array_equal(np.flatnonzero(clip.valid), known)
    found, true = clip.motion, seen.motion
    np.testing.assert_allclose(found.pelvis_m[known], true.pelvis_m[known], atol=0.01)
    np.testing.assert_array_equal(found.pelvis_m[0], found.pelvis_m[2])
    between = (found.pelvis_m[8] + 2 * found.pelvis_m[11 + 1]) / 3
    assert np.linalg.norm(found.pelvis_m[11] - between) < 0.1
    (person,) = record.people
    assert (person.name, person.images, person.first_image) == ("person_0", len(known), 2)
    assert person.median_depth_m == pytest.approx(np.median(true.pelvis_m[known, 2]), rel=0.01)
    assert person.median_depth_in_file_m > 1.2 * person.median_depth_m  # WHAM's guess of the lens
    assert not record.notes and not record.left_out


def test_poses_of_every_second_frame_are_interpolated(seen, neutral, tmp_path):
    """The file's frame 5 is the video's frame 10."""
    half = np.arange(0, N_FRAMES, 2)
    people = [rows_of(seen, half, np.arange(len(half)))]
    config = BodiesConfig(frames_per_row=2)
    slow, quick = tmp_path / "slow", tmp_path / "quick"
    made(slow, people, video(ALL), neutral, config)
    assert load_clip(slow / "bodies" / "person_0.npz").valid.sum() == len(half)  # 0.2 s apart
    made(quick, people, video(ALL, fps_hz=20.0), neutral, config)
    clip = load_clip(quick / "bodies" / "person_0.npz")
    assert clip.valid[:-1].all() and not clip.valid[-1]
    np.testing.assert_allclose(clip.motion.pelvis_m[:-1], seen.motion.pelvis_m[:-1], atol=0.06)
    turned = clip.motion.root_rotmats[:-1] - seen.motion.root_rotmats[:-1]
    assert np.abs(turned).max() < 0.1


@pytest.mark.parametrize(
    ("every", "fps_hz"), [(3, 30000 / 1001), (3, 29.95), (6, 60000 / 1001), (12, 119.88)]
)
def test_poses_a_tenth_of_a_second_apart_are_near_enough_at_rates_of_ntsc(
    every, fps_hz, seen, neutral, tmp_path
):
    """They are 0.1001 s apart, and all frames between were dropped: there was no world."""
    rows = np.arange(0, N_FRAMES, every)
    config = BodiesConfig(frames_per_row=every)
    people = [rows_of(seen, rows, np.arange(len(rows)))]
    made(tmp_path, people, video(ALL, fps_hz=fps_hz), neutral, config)
    clip = load_clip(tmp_path / "bodies" / "person_0.npz")
    np.testing.assert_array_equal(clip.valid, rows[-1] >= ALL)


def write_prompthmr(path: Path, seen: Seen, rows: np.ndarray) -> Path:
    """PromptHMR's file of some rows of the person, before a camera at rest."""
    n, lens = len(rows), Lens.of_matrix(seen.intrinsics_px, SIZE_PX)
    still = np.tile(np.eye(4), (n, 1, 1))
    camera = CameraPath(lens.matrix_px, *SIZE_PX, still, np.ones(n, bool))
    motion = replace(seen.motion.take(rows), frame="world")
    return system_files.write_prompthmr(path, motion, camera, np.arange(n))


@pytest.mark.parametrize(("fps_hz", "first"), [(120.0, 1), (20.0, 0)])
def test_prompthmr_itself_takes_the_last_of_each_two_frames(fps_hz, first, seen, neutral, tmp_path):
    """Above 60 Hz; its poses were taken for those of the frame before.  A video of fewer frames
    that somebody made for it has the first of two, as for the other systems."""
    rows = np.arange(first, N_FRAMES, 2)
    path = write_prompthmr(tmp_path / "results.pkl", seen, rows)
    whole = filmed(seen, video(ALL, N_FRAMES + first, fps_hz))
    record = made_of(path, whole, neutral, BodiesConfig(frames_per_row=2))
    (person,), found = record.people, load_clip(tmp_path / "bodies" / "person_0.npz").motion
    assert (person.first_image, person.last_image) == (rows[0], rows[-1])
    np.testing.assert_allclose(found.pelvis_m[rows], seen.motion.pelvis_m[rows], atol=0.01)
    assert not any("is of 12 frames" in note for note in record.notes)


def test_images_of_every_second_frame_take_their_own_rows(seen, neutral, tmp_path):
    half = np.arange(0, N_FRAMES, 2)
    made(tmp_path, [seen], video(half), neutral)
    clip = load_clip(tmp_path / "bodies" / "person_0.npz")
    assert clip.valid.all() and len(clip.valid) == len(half)
    np.testing.assert_allclose(clip.motion.pelvis_m, seen.motion.pelvis_m[half], atol=0.01)


@pytest.mark.parametrize(("every", "first", "row"), [(2, 0, 1), (3, 1, 0), (4, 0, 1)])
def test_images_of_frames_between_poses_take_what_lies_between(
    every, first, row, seen, neutral, tmp_path
):
    """Of poses of every second frame only those on an image were used: a right file was refused, or
    most of its poses dropped, and people went straight from image to image."""
    numbers, rows = np.arange(first, N_FRAMES, every), np.arange(row, N_FRAMES, 2)
    path = write_prompthmr(tmp_path / "results.pkl", seen, rows)
    # At 120 Hz PromptHMR itself takes the last of each two frames, else the first is taken.
    frames = video(numbers, N_FRAMES, (120.0 if row else 20.0) / every)
    made_of(path, filmed(seen, frames), neutral, BodiesConfig(frames_per_row=2))
    clip = load_clip(tmp_path / "bodies" / "person_0.npz")
    inside = (numbers >= rows[0]) & (numbers <= rows[-1])
    np.testing.assert_array_equal(clip.valid, inside)
    true_m = seen.motion.pelvis_m[numbers[inside]]
    np.testing.assert_allclose(clip.motion.pelvis_m[inside], true_m, atol=0.06)


def test_a_body_of_one_size_gets_no_height(seen, neutral, tmp_path):
    """It stayed as it was, and its size was taken as known to 1.5 %."""
    dirs_m, joint_dirs_m = neutral.shape_dirs_m[..., :0], neutral.joint_shape_dirs_m[..., :0]
    stiff = replace(neutral, name="mine", shape_dirs_m=dirs_m, joint_shape_dirs_m=joint_dirs_m)
    (note,) = made(tmp_path / "plain", [seen], video(ALL), stiff).notes
    assert note.endswith("7 % (give SMPL's neutral model with --body)")
    heights = BodiesConfig(heights=heights_of(1.5))
    with pytest.raises(BadRecipe, match="--height-m: the body mine has one size only; leave it"):
        made(tmp_path / "told", [seen], video(ALL), stiff, heights)


def test_who_is_hardly_seen_is_left_out_and_named(seen, neutral, tmp_path):
    few = np.arange(3)
    record = made(tmp_path, [rows_of(seen, few, few), seen], video(ALL), neutral)
    assert [person.name for person in record.people] == ["person_1"]
    assert record.left_out == ("person_0 is seen in 3 images alone",)


def test_another_body_stands_in_and_says_so(seen, small_body, tmp_path):
    record = made(tmp_path, [seen], video(ALL), small_body)
    assert "size of the mean" in record.notes[0] and "--body" in record.notes[0]


def test_only_people_with_betas_of_smpls_neutral_body_have_their_own_size(seen, neutral, tmp_path):
    """Betas of SMPL's female body were left out, and the mean size passed for the person's own."""
    people = system_files.wham_people([seen, seen])
    people[1]["body"] = "smpl-female"
    path = system_files.write_joblib(tmp_path / "wham_output.pkl", people)
    record = made_of(path, filmed(seen), neutral)
    assert [one.size_sigma for one in record.people] == [0.05, 0.07]
    size = "people have the size of the mean smpl-neutral body, not their own"
    carry = "scale and places carry that error, 7 % (give a height with --height-m)"
    assert record.notes == (f"{size}: {carry}",)


def test_a_size_that_changes_over_time_is_said(seen, neutral, tmp_path):
    """Of two people who are taken for one, the mean size was taken without a word."""
    people = system_files.wham_people([seen, seen])
    grows = neutral.joint_shape_dirs_m[:, 1, 0] / np.ptp(neutral.joints_template_m[:, 1])
    per_beta = grows[JOINT["head"]] - grows[[JOINT["left_foot"], JOINT["right_foot"]]].min()
    for person, share in zip(people.values(), (0.02, 0.08), strict=True):
        person["betas"][:, 0] += share / per_beta * (-1.0) ** np.arange(N_FRAMES)
    path = system_files.write_joblib(tmp_path / "wham_output.pkl", people)
    record = made_of(path, filmed(seen), neutral)
    assert [note[:43] for note in record.notes] == ["person_1: sizes in the file vary by 8%, as "]


def test_a_height_that_is_told_moves_who_has_it(seen, neutral, tmp_path):
    frames, heights = video(ALL), heights_of({"person_0": 1.5, "anna": 1.7})
    plain, told = tmp_path / "plain", tmp_path / "told"
    (before,) = made(plain, [seen], frames, neutral).people
    record = made(told, [seen], frames, neutral, BodiesConfig(heights=heights))
    (after,) = record.people
    assert after.height_m == pytest.approx(1.5, abs=1e-3)
    assert (before.size_sigma, after.size_sigma) == (0.05, 0.015)
    closer = after.median_depth_m / before.median_depth_m
    assert closer == pytest.approx(1.5 / before.height_m, rel=0.03)
    assert record.notes == ("a height of 1.7 m was told of anna, and nobody has that name",)


def test_a_child_whose_height_is_told_is_of_no_adults_proportions(seen, neutral, tmp_path):
    """Distances and the scale had an error of 1.5 % of a child of four years too."""
    sigmas = []
    for height_m in (1.0, 1.78):
        config = BodiesConfig(heights=heights_of({"person_0": height_m}))
        frames = video(ALL)
        (person,) = made(tmp_path / f"{height_m}", [seen], frames, neutral, config).people
        sigmas.append(person.size_sigma)
    assert sigmas == [pytest.approx(0.0758, abs=1e-4), 0.015]


@pytest.mark.parametrize(
    ("frames", "n_frames", "said"),
    [
        (np.arange(12), 12, "is of 24 frames or more, and the video has 12"),
        (np.arange(100, 124), 500, "no person has a pose in two of the video's frames 100-123"),
        (np.arange(100, 124), None, "no person has a pose in two of the video's frames 100-123"),
    ],
)
def test_a_file_of_another_video_is_refused(frames, n_frames, said, seen, neutral, tmp_path):
    with pytest.raises(BadMotionFile, match=said):
        made(tmp_path, [seen], video(frames, n_frames), neutral)


def test_a_file_of_a_part_alone_is_not_taken_for_the_whole_videos(seen, neutral, tmp_path):
    """Its rows count from the part's first frame: bodies stood 12 frames late, where both meet."""
    result = system_files.gvhmr_result(seen)  # of 24 frames
    path = system_files.write_torch(tmp_path / "a" / "hmr4d_results.pt", result)
    late, said = np.arange(12, 12 + N_FRAMES), "the video has 36 or more, as of the part alone"
    with pytest.raises(BadMotionFile, match=f"is of 24 frames, and {said}: another video's"):
        made_of(path, filmed(seen, video(late, None)), neutral)
    whole = system_files.write_torch(tmp_path / "b" / path.name, result)
    record = made_of(whole, filmed(seen, video(np.arange(2, 22), None)), neutral)
    assert record.people[0].images == 20 and len(record.notes) == 1  # on the mean size


def test_phalp_of_the_first_frames_of_a_longer_video_is_taken(seen, neutral, tmp_path):
    """PHALP takes 1300 frames by itself: its files of all longer videos were refused."""
    numbers = np.arange(1286, 1286 + N_FRAMES)
    frames = system_files.phalp_frames([replace(seen, frames=numbers)], 1300)
    path = system_files.write_joblib(tmp_path / "demo_walk.pkl", frames)
    long = filmed(seen, video(numbers, 1800))
    record = made_of(path, long, neutral)
    clip = load_clip(tmp_path / "bodies" / "person_0.npz")
    np.testing.assert_array_equal(numbers[clip.valid], np.arange(1286, 1300))
    told = "PHALP ended after 1300 frames: for the others run it with video.end_frame=-1"
    assert record.notes == (told,)
    frames.popitem()
    path = system_files.write_joblib(tmp_path / "short" / path.name, frames)
    with pytest.raises(BadMotionFile, match=r"of 1299 frames, .* PHALP with video.end_frame=-1"):
        made_of(path, long, neutral)


def test_vibe_of_a_video_that_stops_for_a_moment_is_refused(seen, neutral, tmp_path):
    """VIBE's images are of one rate, with frames repeated: its poses lay on other frames after."""
    people = system_files.vibe_people([seen], np.random.default_rng(0))
    frames = video(ALL)
    for late_s in (0.18, 0.25):  # of 0.1 s from frame to frame
        times_s = frames.times_s + np.where(frames.numbers < 20, 0.0, late_s)
        late = filmed(seen, replace(frames, times_s=times_s))
        path = system_files.write_joblib(tmp_path / f"{late_s}" / "vibe_output.pkl", people)
        if late_s < 0.2:
            assert len(made_of(path, late, neutral).people) == 1
            continue
        part = replace(late.frames, **{
            key: getattr(late.frames, key)[20:]
            for key in ("paths", "numbers", "frame_numbers", "times_s")
        }, n_frames=None)  # fmt: skip
        for some in (late, filmed(seen, part)):  # the part is steady, but late as a whole
            with pytest.raises(BadMotionFile, match=r"up to 0\.25 s off a steady 10 Hz, and VIBE"):
                made_of(path, some, neutral)


def test_somebody_behind_the_camera_is_left_out_and_named(seen, neutral, tmp_path):
    """A ghost of a system's is no reason to refuse the others; where nobody is left, it is."""
    people = system_files.wham_people([seen, seen])
    save_body(tmp_path / "body.npz", neutral)
    others = tmp_path / "body.npz", tmp_path / "out", BodiesConfig()
    ghost, real = people.values()
    ghost["trans"] = -ghost["trans"]
    path = system_files.write_joblib(tmp_path / "wham_output.pkl", people)
    (files,) = make_bodies(path, filmed(seen), *others)
    record = BodiesRecord.read(tmp_path / "out" / "bodies.json")
    assert record.left_out == ("person_0 does not stand before the camera",)
    assert load_clip(files.clip_path).id == record.people[0].name == "person_1"
    real["trans"] = -real["trans"]
    path = system_files.write_joblib(tmp_path / "wham_output.pkl", people)
    with pytest.raises(BadMotionFile, match="person_1 does not stand before the camera"):
        make_bodies(path, filmed(seen), *others, run=Run(redo=True))
