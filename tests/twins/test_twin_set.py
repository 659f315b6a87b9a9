"""A small twin set, rendered for real, read back as 3DPW, and held against its truth."""

import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from gmrdata.cli import main
from gmrdata.film.programmes import camera_programme
from gmrdata.film.render_set import render_dir
from gmrdata.film.scene import SceneConfig
from gmrdata.film.set_plan import SyntheticClip, SyntheticRecipe
from gmrdata.motion.gait import make_gait
from gmrdata.read.body_file import read_body, save_body
from gmrdata.read.frames import read_color
from gmrdata.read.threedpw import read_sequence
from gmrdata.read.threedpw_files import find_sequences
from gmrdata.stage.recipes import find_recipe, load_recipe
from gmrdata.stage.run import Run
from gmrdata.threedpw.clips import camera_clip
from gmrdata.threedpw.regenerate import sequence_rows
from gmrdata.twins import twin_set
from gmrdata.twins.twin_set import (
    TwinRecipe,
    TwinSequence,
    TwinsRecord,
    make_twins,
    read_truth,
    write_sequence_twin,
)
from gmrdata.values.camera import project
from gmrdata.values.clip import Clip, camera_of, load_clip, save_clip
from gmrdata.values.errors import (
    BadRecord,
    BadSequence,
    MissingInput,
    NothingMade,
    StageFailed,
    StaleOutput,
)
from gmrdata.values.files import read_json, write_json
from gmrdata.world.compose import motion_in_camera
from tests.record_keys import assert_each_key_is_needed

SHIPPED = load_recipe(find_recipe("twins_small"), TwinRecipe)
TWO, ONE = "courtyard_together_00", "room_walk_00"
PEOPLE = [(TWO, 0), (TWO, 1), (ONE, 0)]


def smaller() -> TwinRecipe:
    """The shipped recipe with half the frames, half as wide, and a room, which is painted soon."""
    given = SHIPPED.model_dump(mode="json")
    given["set"]["film"] |= {"duration_s": 0.4, "width_px": 90, "height_px": 160}
    one = given["set"]["clips"][1]
    one |= {"id": ONE, "scene": {"kind": "room", "seed": 4, "extras": {"passers_by": 1}}}
    return TwinRecipe.model_validate(given | {"splits": {ONE: "train"}})


RECIPE = smaller()


def wrong(**changes: object) -> dict[str, object]:
    given = SHIPPED.model_dump(mode="json")
    given["set"] |= changes
    return given


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"film": {"fps_hz": 10}}, "3DPW has 30 frames a second"),
        ({"film": {}}, "3DPW has 30 frames a second"),
        ({"render": {"image_format": "png"}}, "images are jpg"),
        ({"camera_off": True}, "name each sequence"),
        (
            {"clips": [{"id": "-a", "gait": "walk", "programme": {"kind": "static"}}]},
            r"clips\.0\.id",
        ),
        ({"clips": []}, "splits: no clips park_walk_00"),
    ],
)
def test_a_set_that_does_not_fit_the_layout_is_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        TwinRecipe.model_validate(wrong(**changes))


def test_a_dry_run_lists_the_sequences_and_makes_nothing(tmp_path, anny, capsys):
    main(["threedpw", "twin", "twins_small", "--out", str(tmp_path), "--dry-run", "--no-probe"])
    said = capsys.readouterr().out
    assert "courtyard_together_00" in said and "2 clips, 48 frames; to do: 2 clips" in said
    assert not list(tmp_path.iterdir())


@pytest.fixture(scope="module")
def out(tmp_path_factory, anny) -> Path:
    folder = tmp_path_factory.mktemp("twins")
    recipe = folder / "smaller.yaml"
    recipe.write_text(yaml.safe_dump(RECIPE.model_dump(mode="json")), encoding="utf-8")
    main(["threedpw", "twin", str(recipe), "--out", str(folder / "out")])
    return folder / "out"


def truth_of(out: Path, name: str, person: int) -> Clip:
    return load_clip(out / "truth" / f"{name}.p{person}.npz")


def files_of(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != "stage.json" and not path.name.startswith(".")
    }


@pytest.mark.slow
def test_the_reader_finds_sequences_without_a_problem(out):
    rows, n_bad = sequence_rows(out / "3DPW", "campose_valid")
    assert n_bad == 0 and [row[0] for row in rows] == [ONE, TWO]
    for name, n_people, split in ((TWO, 2, "test"), (ONE, 1, "train")):
        sequence = read_sequence(out / "3DPW", name)
        assert sequence.problems == () and sequence.files.split == split
        assert sequence.n_frames == 12 and len(sequence.arrays.people) == n_people
        assert (sequence.images.width_px, sequence.images.height_px) == (90, 160)
        assert sequence.arrays.intrinsics_px[0, 0] == pytest.approx(1961.9 / 1080 * 90, rel=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "person"), PEOPLE)
def test_camera_frame_bodies_are_the_truth_within_the_faults(out, name, person):
    truth = truth_of(out, name, person)
    body = read_body(out / "render_set" / "body" / "body.npz")
    found = camera_clip(read_sequence(out / "3DPW", name), person, [body])
    true = motion_in_camera(truth.motion, camera_of(truth).world_from_cam)
    faults = RECIPE.twin.faults
    off_m = np.linalg.norm(found.motion.pelvis_m - true.pelvis_m, axis=1)[found.valid]
    assert 0.004 < off_m.max() <= faults.root_error_m[1] + 1e-9
    turns = true.root_rotmats.swapaxes(-1, -2) @ found.motion.root_rotmats
    off_deg = np.rad2deg(Rotation.from_matrix(turns).magnitude())
    assert 0.1 < off_deg.max() <= faults.root_error_deg[1] + 1e-6
    joints = true.local_rotmats.swapaxes(-1, -2) @ found.motion.local_rotmats
    noise_deg = np.rad2deg(Rotation.from_matrix(joints.reshape(-1, 3, 3)).magnitude())
    assert 2.0 < np.sqrt((noise_deg**2).mean()) < 4.0
    np.testing.assert_allclose(found.motion.shape, truth.motion.shape, atol=1e-12)
    assert 2 <= (~found.valid).sum() <= 4


@pytest.mark.slow
@pytest.mark.parametrize(("name", "person"), PEOPLE)
def test_each_annotated_person_is_where_the_image_shows_that_person(out, name, person):
    truth = truth_of(out, name, person)
    camera = camera_of(truth)
    pelvis_px = project(camera.world_from_cam, truth.motion.pelvis_m[:, None], camera.intrinsics_px)
    seen = []
    for row, (x, y) in enumerate(pelvis_px[:, 0].astype(int)):
        path = out / "render_set" / "render" / name / "instances" / f"{row:05d}.png"
        picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        assert picture is not None
        seen.append(int(picture[y, x]))
    assert (np.array(seen) == person + 1).mean() > 0.9


@pytest.mark.slow
def test_the_index_says_what_each_sequence_is(out):
    two, one = read_json(out / "truth" / "twins.json")["sequences"]
    said = two["name"], two["class_true"], two["trial"], two["people"]
    assert said == (TWO, "circular", "gait walk", 2)
    assert (one["class_true"], one["people"], one["scene"]["kind"]) == ("panning", 1, "room")


@pytest.mark.slow
def test_exposure_changes_the_frames_as_planned_and_the_shutter_was_open(out):
    for name in (TWO, ONE):
        rendered = out / "render_set" / "render" / name
        assert read_json(rendered / "stage.json")["config"]["shutter"] == 0.5
        gains = np.load(out / "truth" / f"{name}.exposure.npz")["gains"]
        ratios = [
            read_color(out / "3DPW" / "imageFiles" / name / f"image_{row:05d}.jpg").mean()
            / read_color(rendered / "frames" / f"{row:05d}.jpg").mean()
            for row in range(12)
        ]
        assert np.ptp(gains) > 0.25
        # Light goes as value^2.2; what is white already can't get brighter.
        assert np.corrcoef(np.log(ratios), np.log(gains))[0, 1] > 0.99
        np.testing.assert_allclose(np.array(ratios) ** 2.2, gains, rtol=0.12)


@pytest.mark.slow
def test_once_more_does_nothing(out):
    def times_ns() -> dict[Path, int]:
        paths = [p for part in ("3DPW", "truth", "render_set/render") for p in out.glob(part)]
        files = [f for p in paths for f in p.rglob("*") if not f.name.startswith(".")]
        return {f: f.stat().st_mtime_ns for f in files if f.is_file()}

    before = times_ns()
    make_twins(RECIPE, out)
    assert times_ns() == before


@pytest.mark.slow
def test_faults_hang_on_the_seed_and_the_name_alone(out, tmp_path):
    clips = RECIPE.set.clips
    reversed_set = RECIPE.set.model_copy(update={"clips": clips[::-1]})
    for folder, recipe, order in (
        ("a", RECIPE.model_copy(update={"set": reversed_set}), clips[::-1]),
        ("b", reseeded(2), clips),
    ):
        (tmp_path / folder).mkdir()
        shutil.copytree(out / "render_set", tmp_path / folder / "render_set")
        for clip in order:
            write_sequence_twin(recipe, clip, tmp_path / folder)
    expected = files_of(out / "3DPW")
    assert files_of(tmp_path / "a" / "3DPW") == expected
    other = files_of(tmp_path / "b" / "3DPW")
    assert other.keys() == expected.keys()
    assert all(other[name] != expected[name] for name in expected)


def reseeded(seed: int) -> TwinRecipe:
    return RECIPE.model_copy(update={"set": RECIPE.set.model_copy(update={"seed": seed})})


@pytest.mark.slow
def test_another_split_is_refused_and_with_redo_leaves_no_second_file(out, tmp_path):
    copy = shutil.copytree(out, tmp_path / "copy")
    moved = RECIPE.model_copy(update={"splits": {}})
    clip = RECIPE.set.clips[1]
    with pytest.raises(StaleOutput, match=r"config\.split"):
        write_sequence_twin(moved, clip, copy)
    write_sequence_twin(moved, clip, copy, run=Run(redo=True))
    found = sorted((copy / "3DPW").rglob(f"{ONE}.pkl"))
    assert [path.parent.name for path in found] == ["test"]
    assert read_sequence(copy / "3DPW", ONE).problems == ()


def test_what_a_sequence_lost_is_made_again(tmp_path, walkers, small_body, jpeg):
    """The error said to make the twins again, and that did nothing."""
    clip, rendered = RECIPE.set.clips[1], render_dir(tmp_path / "render_set", ONE)
    (rendered / "frames").mkdir(parents=True)
    for row in range(walkers[0].motion.n_frames):
        (rendered / "frames" / f"{row:05d}.jpg").write_bytes(jpeg(90, 160))
    rest_pelvis_m = small_body.rest_pelvis_m(walkers[0].motion.shape)
    save_clip(rendered / "clip.npz", walkers[0], rest_pelvis_m)
    save_body(tmp_path / "render_set" / "body" / "body.npz", small_body)
    write_sequence_twin(RECIPE, clip, tmp_path)
    made = files_of(tmp_path)
    lost = [name for name in made if name.endswith((".pkl", ".p0.npz", ".exposure.npz"))]
    assert len(lost) == 3
    for name in lost:
        (tmp_path / name).unlink()
        with pytest.raises(StaleOutput, match=r"config\.seed"):
            write_sequence_twin(reseeded(2), clip, tmp_path)
        assert files_of(tmp_path).keys() == made.keys() - {name}
        write_sequence_twin(RECIPE, clip, tmp_path)
        assert files_of(tmp_path) == made


@pytest.mark.slow
def test_a_redo_that_is_stopped_leaves_nothing_that_looks_made(out, tmp_path, monkeypatch):
    """The old recipe found its images, and no annotations of them."""
    shutil.copytree(out, tmp_path / "copy")
    clip = RECIPE.set.clips[1]

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(twin_set, "write_twin", stop)
        write_sequence_twin(reseeded(2), clip, tmp_path / "copy", run=Run(redo=True))
    write_sequence_twin(RECIPE, clip, tmp_path / "copy")
    assert files_of(tmp_path / "copy" / "3DPW") == files_of(out / "3DPW")


@pytest.mark.slow
def test_a_clip_that_fails_is_named_and_the_others_are_written(out, tmp_path):
    shutil.copytree(out / "render_set", tmp_path / "render_set")
    programme = {"kind": "linear", "speed_m_per_s": 50.0}
    gone = SyntheticClip.model_validate({"id": "gone_00", "gait": "walk", "programme": programme})
    clips = (gone, *RECIPE.set.clips)
    recipe = RECIPE.model_copy(update={"set": RECIPE.set.model_copy(update={"clips": clips})})
    # It rendered once, and so did one that the recipe has no more.
    for name in ("gone_00", "former_00"):
        leave_twin(out, tmp_path, name)
    with pytest.raises(StageFailed, match="gone_00: a linear camera can't keep"):
        make_twins(recipe, tmp_path)
    assert files_of(tmp_path / "3DPW") == files_of(out / "3DPW")
    assert files_of(tmp_path / "truth").keys() == files_of(out / "truth").keys()
    listed = read_json(tmp_path / "truth" / "twins.json")["sequences"]
    assert [sequence["name"] for sequence in listed] == [clip.id for clip in RECIPE.set.clips]


def leave_twin(out: Path, folder: Path, name: str) -> None:
    """One more twin in a folder: the one with a single person, by another name."""
    for path in (f"imageFiles/{ONE}", f"sequenceFiles/train/{ONE}.pkl"):
        source, target = out / "3DPW" / path, folder / "3DPW" / path.replace(ONE, name)
        target.parent.mkdir(parents=True, exist_ok=True)
        (shutil.copytree if source.is_dir() else shutil.copy)(source, target)
    (folder / "truth").mkdir(exist_ok=True)
    for kind in ("p0", "exposure"):
        shutil.copy(out / "truth" / f"{ONE}.{kind}.npz", folder / "truth" / f"{name}.{kind}.npz")


@pytest.mark.slow
def test_a_sequence_that_no_recipe_made_stays(out, tmp_path):
    """The folder may hold 3DPW itself."""
    shutil.copytree(out, tmp_path / "copy")
    leave_twin(out, tmp_path / "copy", "downtown_00")
    (tmp_path / "copy" / "3DPW" / "imageFiles" / "downtown_00" / "stage.json").unlink()
    make_twins(RECIPE, tmp_path / "copy")
    assert "downtown_00" in [one.name for one in find_sequences(tmp_path / "copy" / "3DPW")]
    assert (tmp_path / "copy" / "3DPW" / "imageFiles" / "downtown_00").is_dir()


def test_a_set_of_which_nothing_was_rendered_says_why(tmp_path, no_scheduler):
    """A clip that was never begun counted as rendered, and its file was missing."""
    with pytest.raises(StageFailed, match=f"no Dask scheduler at {no_scheduler}"):
        make_twins(RECIPE, tmp_path, run=Run(scheduler=no_scheduler))


def test_what_gmrdata_made_is_left_out_of_its_motions_with_one_remark(tmp_path, capsys):
    """`gmrdata motions` said so, twins and rendered sets did not."""
    for name in ("walk.bvh", "made/walk_1.bvh", "made/stage.json"):
        (tmp_path / "motions" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "motions" / name).write_text("broken")
    clips = [{"id": "a", "trial": "walk", "programme": {"kind": "small"}}]
    made = SyntheticRecipe.model_validate(RECIPE.set.model_dump() | {"clips": clips})
    recipe = RECIPE.model_copy(update={"set": made})
    with pytest.raises(NothingMade, match=r"walk\.bvh"):
        make_twins(recipe, tmp_path / "out", motions_dir=tmp_path / "motions")
    left_out = f"{tmp_path / 'motions' / 'made' / 'walk_1.bvh'}: left out, as gmrdata made it\n"
    assert capsys.readouterr().err.count(left_out) == 1


def write_index(folder: Path, record: Any) -> None:
    (folder / "truth").mkdir(exist_ok=True)
    write_json(folder / "truth" / "twins.json", record)


def about(name: str, kind: str, people: int) -> dict[str, Any]:
    seen: dict[str, Any] = {"scene": {"kind": "park"}, "programme": {"kind": "static"}}
    return {"name": name, "class_true": kind, "people": people, "trial": "gait walk"} | seen


def test_people_come_in_order(tmp_path, small_body):
    rows = [about("park_00", "linear", 2), about("park", "static", 1)]
    write_index(tmp_path, {"format": "gmrdata-twins/1", "sequences": rows})
    motion = make_gait("walk", 0.5, 30.0, small_body, np.random.default_rng(0))
    n = np.arange(motion.n_frames)
    for id in ("park_00.p0", "park_00.p1"):
        rest_pelvis_m = small_body.rest_pelvis_m(motion.shape)
        save_clip(
            tmp_path / "truth" / f"{id}.npz", Clip(id, motion, n >= 0, n, None), rest_pelvis_m
        )
    twins = read_truth(tmp_path)
    assert twins.classes == {"park_00": "linear", "park": "static"}
    assert twins.root == tmp_path / "3DPW"
    assert [clip.id for clip in twins.people("park_00")] == ["park_00.p0", "park_00.p1"]
    with pytest.raises(MissingInput, match=r"no park\.p0\.npz"):
        twins.people("park")
    with pytest.raises(MissingInput, match="no twin 'room_00'; there are park_00, park"):
        twins.people("room_00")
    # Who was missing counted as nobody, or ended the floor with a traceback.
    (tmp_path / "truth" / "park_00.p1.npz").unlink()
    with pytest.raises(MissingInput, match=r"no park_00\.p1\.npz; make the twins again"):
        twins.people("park_00")


@pytest.mark.parametrize(
    ("record", "said"),
    [
        ([], "has no `format`"),
        ({"sequences": [about("a", "linear", 1)]}, "has no `format`.*make it again.*--redo"),
        ({"format": "gmrdata-twins/1"}, "has no key `sequences`"),
        ({"format": "gmrdata-twins/1", "sequences": [{"name": "a"}]}, "sequences.0.class_true`"),
        ({"format": "gmrdata-twins/1", "sequences": [1]}, "`sequences.0` is wrong"),
    ],
)
def test_a_broken_index_is_named(tmp_path, record, said):
    write_index(tmp_path, record)
    with pytest.raises(BadRecord, match=rf"twins\.json: .*{said}"):
        read_truth(tmp_path)


def test_names_lead_nowhere_else(tmp_path):
    rows = [about("../../x", "linear", 1)]
    write_index(tmp_path, {"format": "gmrdata-twins/1", "sequences": rows})
    with pytest.raises(BadSequence, match="is no name of a sequence"):
        read_truth(tmp_path)


def test_a_folder_without_index_is_no_twin_set(tmp_path):
    with pytest.raises(MissingInput, match="give a folder that `gmrdata threedpw twin` made"):
        read_truth(tmp_path)


def test_each_key_of_the_index_is_needed(tmp_path):
    sequence = TwinSequence(
        "park_00", "static", "gait walk", 1, SceneConfig(), camera_programme("static")
    )
    record = TwinsRecord(sequences=(sequence,))
    # Scene and programme are parts of a recipe, with its defaults.
    free = ("sequences.0.scene", "sequences.0.scene.extras", "sequences.0.programme")
    assert_each_key_is_needed(record, tmp_path / "twins.json", free)
