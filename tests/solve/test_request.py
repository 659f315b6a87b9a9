"""What is asked of a sequence, as its stages get it."""

import gc
import shutil
import weakref
from pathlib import Path

import numpy as np
import pytest

from gmrdata import SequenceConfig, solve_sequence, solve_video
from gmrdata.cameras.files import Distortion
from gmrdata.cameras.lens.vanishing_points import LinesConfig
from gmrdata.film.programmes import Circular
from gmrdata.motion.gait import make_gait
from gmrdata.people.sources import FolderSource, MasksConfig
from gmrdata.read.models import MODELS, POSE_LANDMARKS, QUICK_LANDMARKS, models_dir
from gmrdata.solve import solve as solving
from gmrdata.solve.request import (
    FOLLOWED,
    GivenPeople,
    PeopleBySystem,
    SolveConfig,
    Solved,
    SolveRequest,
)
from gmrdata.solve.solve import (
    GRAVITY_FILE,
    _masks_of_people,
    _own_doubts,
    _own_poses_dir,
    _world,
    make_masks,
)
from gmrdata.solve.verdict import PAGE, VIEW
from gmrdata.stage.run import Run
from gmrdata.stage.store import StageRecord, run_stage
from gmrdata.values.camera import CameraPath
from gmrdata.values.clip import Clip, camera_of, load_clip, save_clip
from gmrdata.values.errors import (
    BadRecipe,
    BadRecord,
    MissingInput,
    NoReconstruction,
    StaleOutput,
)
from gmrdata.values.people import POSES_FILE, LocalPoses, LocalPosesRecord, PersonFiles
from gmrdata.values.records import Config
from gmrdata.world.bodies import BodiesConfig
from tests.frame_sets import frame_set, grey_images
from tests.reconstructions import quality_of_path
from tests.world.test_compose import as_input, true_clip


@pytest.mark.parametrize(("poses", "network"), [("none", QUICK_LANDMARKS), (None, POSE_LANDMARKS)])
def test_cameras_alone_get_masks_by_the_quick_network(
    shared_path, tmp_path, monkeypatch, poses, network
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    models_dir().mkdir(parents=True)
    for model in MODELS:
        shutil.copy(shared_path(f"models/{model.name}"), models_dir())
    frames = grey_images(tmp_path / "frames")
    solve_video(frames, tmp_path / "out", poses=poses, fps_hz=30)
    record = StageRecord.of(tmp_path / "out" / FOLLOWED)
    assert record.inputs["landmarks"] == network.sha256
    assert_nothing_is_left_of_another_video(frames, tmp_path / "out", poses)


def test_a_result_is_in_a_folder_of_its_own(tmp_path):
    """Its files among the frames would make them others; in a folder among them they don't."""
    frames = grey_images(tmp_path / "frames")
    with pytest.raises(StaleOutput, match=r"frames: is the folder of frames. Pass another --out"):
        solve_video(frames, frames, poses="none", fps_hz=30)
    masks = grey_images(tmp_path / "masks")
    config = MasksConfig(sources=(FolderSource(path=masks),))
    for _ in range(2):
        solve_video(
            frames, frames / "out", poses="none", fps_hz=30, config=SolveConfig(masks=config)
        )
        make_masks(frames, frames / "again", config)
    folders = {path.name for path in frames.iterdir() if path.is_dir()}
    assert folders == {"out", "again"}


def test_without_masks_none_of_an_earlier_run_are_left(tmp_path):
    frames, masks = (grey_images(tmp_path / name) for name in ("frames", "own"))
    out = tmp_path / "out"

    def solved_by(*sources: FolderSource, redo: bool) -> None:
        config = SolveConfig(masks=MasksConfig(sources=sources) if sources else None)
        run = Run(redo=redo)
        solve_video(frames, out, poses="none", fps_hz=30, config=config, run=run)

    solved_by(FolderSource(path=masks), redo=False)
    assert (out / "masks").is_dir()
    # Its page would draw them, and its export hand them on.
    with pytest.raises(StaleOutput, match="holds masks, and now none are asked for.*--redo"):
        solved_by(redo=False)
    solved_by(redo=True)
    assert not (out / "masks").exists() and not (out / "masks_by" / "folder").exists()


def assert_nothing_is_left_of_another_video(frames: Path, out: Path, poses: str | None) -> None:
    """Now there are neither cameras nor people, and its own were exported as if they were."""
    folders = [out / name for name in ("sfm", "bodies", "pseudo_gt")]
    for folder in folders:
        run_stage("other", folder, Config(), {}, lambda _: None)
    with pytest.raises(StaleOutput, match="--redo"):
        solve_video(frames, out, poses=poses, fps_hz=30)
    solve_video(frames, out, poses=poses, fps_hz=30, run=Run(redo=True))
    assert not any(folder.exists() for folder in folders)


@pytest.mark.parametrize("poses", [None, "own", "none"])
def test_rows_of_every_second_frame_are_of_a_systems_file(tmp_path, poses):
    """Own people of frame 10 were placed in frame 20, where only a part of the video was read."""
    config = SolveConfig(bodies=BodiesConfig(frames_per_row=2))
    with pytest.raises(BadRecipe, match="--poses-every is of another system's file"):
        solve_video(tmp_path / "walk.mp4", tmp_path / "out", poses=poses, config=config)
    assert not (tmp_path / "out").exists()


def test_masks_of_bodies_are_refused_before_frames_are_written(tmp_path):
    """Of a recipe without sources, too, it was said at the masks, with a flag of another verb."""
    for poses in (None, "none", tmp_path / "wham_output.pkl"):
        config = SolveConfig(masks=MasksConfig(max_masked_share=0.8))
        with pytest.raises(BadRecipe, match="silhouette needs a body before any camera is known"):
            solve_video(tmp_path / "walk.mp4", tmp_path / "out", poses=poses, config=config)
        assert not (tmp_path / "out").exists()


def test_a_sequence_without_people_is_refused(tmp_path):
    frames, config = grey_images(tmp_path / "frames"), SequenceConfig(masks=None)
    with pytest.raises(MissingInput, match="frames: nobody is given"):
        solve_sequence(frames, (), tmp_path / "out", config)
    assert not (tmp_path / "out").exists()


def test_a_page_of_another_result_of_a_sequence_is_not_left(small_body, tmp_path):
    """After --redo --no-page it showed the cameras of before, as did its files."""
    true = true_clip(small_body, Circular()).take(slice(4))
    save_clip(tmp_path / "in.npz", as_input(true), small_body.rest_pelvis_m(true.motion.shape))
    people, out = (PersonFiles(tmp_path / "in.npz", tmp_path / "body.npz"),), tmp_path / "out"
    shown = [out / name for name in (PAGE, VIEW, "files/tum/camera.txt", "files/tum/out.txt")]

    def solve_again(name: str, run: Run, error: type[Exception]) -> list[bool]:
        grey_images(tmp_path / name, 4, lens_px)
        masks = MasksConfig(sources=(FolderSource(path=tmp_path / name),))
        with pytest.raises(error):
            solve_sequence(frames, people, out, SequenceConfig(masks=masks), run=run)
        return [path.exists() for path in shown]

    lens_px = camera_of(true).lens.size_px
    frames = grey_images(tmp_path / "frames", 4, lens_px)
    assert not any(solve_again("masks", Run(), NoReconstruction))
    run_stage("pseudo-gt", out / "pseudo_gt", Config(), {}, lambda _: None)
    (out / "files" / "tum").mkdir(parents=True)
    for path in shown:
        path.write_text("of the first result")
    assert all(solve_again("masks", Run(), StaleOutput))
    assert all(solve_again("other", Run(), StaleOutput))
    assert not any(solve_again("other", Run(redo=True), NoReconstruction))


def test_the_whole_recipe_of_a_sequence_counts(tmp_path, monkeypatch):
    """Its lines were left out without a word, and found as usual."""
    asked = SequenceConfig(masks=None, lines=LinesConfig(frames=3))

    def solve(request, out_dir, config, run):
        assert {key: getattr(config, key) for key in SequenceConfig.model_fields} == dict(asked)
        raise NoReconstruction("none is made here")

    monkeypatch.setattr(solving, "solve", solve)
    with pytest.raises(NoReconstruction, match="none is made here"):
        solve_sequence(tmp_path, (PersonFiles(tmp_path, tmp_path),), tmp_path / "out", asked)


def test_a_source_that_is_not_there_is_said_first(tmp_path):
    with pytest.raises(MissingInput, match=r"gone.mp4: no such video, or folder of images"):
        solve_video(tmp_path / "gone.mp4", tmp_path / "out", poses="none")
    assert not (tmp_path / "out").exists()


def test_what_is_said_of_people_is_left_aside_where_their_networks_were_not_fetched(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "empty"))
    given = grey_images(tmp_path / "frames"), tmp_path / "out"
    told = {"fps_hz": 30, "height_m": 1.78, "gravity": tmp_path / "gravity.csv"}
    config = SolveConfig(masks=None)
    verdict_path = solve_video(*given, config=config, **told)
    assert "cameras alone, without people" in capsys.readouterr().err
    assert verdict_path.is_file() and not (tmp_path / "out" / GRAVITY_FILE).exists()
    with pytest.raises(BadRecipe, match="--height-m is for people; leave it out for cameras alone"):
        solve_video(*given, poses="none", config=config, **told)


@pytest.mark.parametrize(("people", "bends"), [(PeopleBySystem(), True), (GivenPeople(()), False)])
def test_bodies_are_held_to_pictures_by_the_lens_that_placed_them(tmp_path, people, bends):
    """A data set's were laid onto its pictures by a pinhole; others see them without distortion."""
    nowhere = CameraPath(np.eye(3), 64, 48, np.tile(np.eye(4), (3, 1, 1)), np.ones(3, bool))
    lens = Distortion(-0.2, 0.0, 0.5)
    quality_of_path(nowhere).model_copy(update={"lens": lens}).write(tmp_path / "quality.json")
    frames, request = frame_set(np.arange(3), (64, 48), 30.0), SolveRequest(tmp_path, people)
    solved = Solved(request, tmp_path, SolveConfig(), frames, sfm_dir=tmp_path)
    masks = _masks_of_people(solved)
    assert masks is not None and masks.distortion == (lens if bends else None)


def test_poses_of_the_built_in_estimator_that_are_given_have_its_errors_and_doubts(tmp_path):
    """Another video's folder, or this one's again: their feet were believed as another system's."""
    of_others, poses_dir = tmp_path / "wham_output.pkl", tmp_path / "own_poses" / "poses"
    poses_dir.mkdir(parents=True)
    LocalPosesRecord(
        people=2,
        images=9,
        frames=9,
        size_px=(64, 48),
        focal_px=(60.0, 60.0),
        centre_px=(32.0, 24.0),
        radial=(0.0, 0.0),
        body="anny",
        doubts=("", "it looks away"),
    ).write(poses_dir / POSES_FILE)
    frames, found = frame_set(np.arange(3), (64, 48), 30.0), []
    for people in (PeopleBySystem(), PeopleBySystem(poses_dir), PeopleBySystem(of_others)):
        request = SolveRequest(tmp_path, people)
        solved = Solved(request, tmp_path, SolveConfig(), frames)
        found.append((_own_poses_dir(solved), _own_doubts(solved)))
    own = poses_dir, {"person_1": "it looks away"}
    assert found == [own, own, (None, {})]


@pytest.mark.parametrize("numbers", [[2, 1, 0], [0, 0, 1], [-1, 0, 1]])
def test_poses_in_no_order_of_frames_are_refused(numbers, tmp_path):
    """Each was taken for the person in another frame."""
    turns = np.tile(np.eye(3), (3, 24, 1, 1))
    poses = LocalPoses(np.array(numbers), turns[:, 1:], turns[:, 0], np.ones((3, 3)))
    poses.write(tmp_path / "person_0.npz")
    with pytest.raises(BadRecord, match=r"person_0\.npz: its frame_numbers do not rise from 0"):
        LocalPoses.read(tmp_path / "person_0.npz")


def test_clips_are_let_go_of_before_their_world_is_made(small_body, tmp_path, monkeypatch):
    """Those of 46 people in a film were in memory twice, 1.6 GB more."""
    motion = make_gait("walk", 0.3, 30.0, small_body, np.random.default_rng(1))
    n, path = motion.n_frames, tmp_path / "person.npz"
    clip = Clip("walk", motion, np.ones(n, dtype=bool), np.arange(n), None)
    save_clip(path, clip, small_body.rest_pelvis_m(motion.shape))
    loaded: list[weakref.ref[Clip]] = []

    def load(path: Path) -> Clip:
        clip = load_clip(path)
        loaded.append(weakref.ref(clip))
        return clip

    def make(*_, **__):
        gc.collect()
        assert [one() for one in loaded] == [None]
        raise NoReconstruction("none is made here")

    monkeypatch.setattr(solving, "load_clip", load)
    monkeypatch.setattr(solving, "_lines", lambda solved: solved.out_dir)
    monkeypatch.setattr(solving, "make_pseudo_gt", make)
    people = GivenPeople((PersonFiles(path, tmp_path / "body.npz"),))
    frames, config = frame_set(np.arange(n), (64, 48), 30.0), SolveConfig(masks=None)
    request = SolveRequest(tmp_path, people)
    solved = Solved(request, tmp_path, config, frames, sfm_dir=tmp_path, bodies=people.files)
    assert str(_world(solved).unsolved) == "none is made here"
