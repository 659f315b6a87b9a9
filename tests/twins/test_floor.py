"""`gmrdata floor` on twins that are given: filmed, regenerated, measured."""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from gmrdata.cli import main
from gmrdata.film.programmes import camera_programme
from gmrdata.film.scene import SceneConfig
from gmrdata.manifest.read import load_clips
from gmrdata.read.body_file import read_body
from gmrdata.stage.progress import console
from gmrdata.stage.recipes import load_recipe
from gmrdata.stage.run import Run
from gmrdata.threedpw.recipe import ThreedpwRecipe
from gmrdata.twins.floor import floor_of_twins, measure, measure_floor, sampled_floor
from gmrdata.twins.floor_record import Floor
from gmrdata.twins.pseudo_gt_error import compare_clips
from gmrdata.twins.twin_set import TwinRecipe, TwinSequence, TwinsRecord, read_truth
from gmrdata.values.clip import save_clip
from gmrdata.values.errors import BadBodyFile, BadManifest, MissingInput, NothingMade

pytestmark = pytest.mark.slow

CLASSES = {"arc_00": "circular", "pan_00": "panning"}


def twin(name: str, kind: str, people: int) -> TwinSequence:
    programme = camera_programme("static")
    return TwinSequence(name, kind, "gait walk", people, SceneConfig(), programme)


def write_truth(made: Any, folder: Path) -> None:
    body = read_body(made.body_path)
    for clips in made.truth.values():
        for clip in clips:
            rest_pelvis_m = body.rest_pelvis_m(clip.motion.shape)
            save_clip(folder / "truth" / f"{clip.id}.npz", clip, rest_pelvis_m)
    sequences = tuple(twin(name, kind, len(made.truth[name])) for name, kind in CLASSES.items())
    TwinsRecord(sequences=sequences).write(folder / "truth" / "twins.json")


@pytest.fixture(scope="module")
def place(filmed_set, made_set, tmp_path_factory) -> Path:
    """A folder with `twins`, a recipe, and the output of the verb.

    The verb goes on with a regeneration that was stopped before the last stage of `pan_00`.
    """
    folder = tmp_path_factory.mktemp("floor")
    begun = folder / "out" / "regenerated" / "sequences"
    shutil.copytree(made_set / "sequences", begun)
    shutil.rmtree(begun / "pan_00" / "pseudo_gt")
    shutil.copytree(filmed_set.root, folder / "twins" / "3DPW")
    write_truth(filmed_set, folder / "twins")
    recipe = filmed_set.recipe().model_dump(mode="json")
    (folder / "recipe.yaml").write_text(yaml.safe_dump(recipe), encoding="utf-8")
    answer = floor_verb(folder)
    assert answer.returncode == 0, answer.stderr
    (folder / "said.txt").write_text(answer.stdout, encoding="utf-8")
    return folder


def words(folder: Path, *more: str) -> list[str]:
    given = ["--twins", str(folder / "twins"), "--recipe", str(folder / "recipe.yaml")]
    return ["floor", *given, "--out", str(folder / "out"), *more]


def floor_verb(folder: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "gmrdata", *words(folder)]
    wide = os.environ | {"COLUMNS": "200"}
    return subprocess.run(command, capture_output=True, text=True, check=False, env=wide)


def test_a_dry_run_says_what_is_done(place, capsys, monkeypatch):
    monkeypatch.setattr(console, "width", 200)
    main(words(place, "--dry-run"))
    said = capsys.readouterr().out
    assert said.count("done") == 2 and "to do" not in said
    main(words(place, "--dry-run", "--out", str(place / "other")))
    said = capsys.readouterr().out
    assert said.count("to do: people, masks, sfm, lines, pseudo_gt") == 2
    assert not (place / "other").exists()


def test_the_figures_are_those_of_the_manifests_clips(place, filmed_set):
    floor = Floor.read(place / "out" / "floor.json")
    rows = {row.id: row for row in floor.sequences}
    assert {name: row.class_true for name, row in rows.items()} == CLASSES
    assert {name: row.class_measured for name, row in rows.items()} == CLASSES
    body = read_body(filmed_set.body_path)
    found = {clip.id: clip for clip in load_clips(place / "out/regenerated/pseudo_gt.yaml")}
    n_motions = weighted_mm = 0.0
    for name, people in filmed_set.truth.items():
        assert [person.id for person in rows[name].people] == [clip.id for clip in people]
        for true, person in zip(people, rows[name].people, strict=True):
            error = compare_clips(found[true.id], true, fps_hz=10.0, body=body)
            assert error.vme_mm is not None and person.n_motions == error.n_motions
            for key in ("ome_deg", "tme_mm", "vme_mm", "camera_path_mm"):
                assert getattr(person, key) == pytest.approx(getattr(error, key), rel=1e-5)
            n_motions += error.n_motions
            weighted_mm += error.n_motions * error.vme_mm
    assert floor.overall.n_motions == n_motions
    assert floor.overall.vme_mm == pytest.approx(weighted_mm / n_motions, rel=1e-5)


def test_small_errors_all_accepted_and_the_scale_where_it_enters(place):
    floor = Floor.read(place / "out" / "floor.json")
    arc, pan = floor.classes["circular"], floor.classes["panning"]
    assert (arc.accepted, pan.accepted, floor.overall.class_right) == (1, 1, 2)
    for group in (arc, pan):
        assert group.ome_deg is not None and 0 < group.ome_deg < 0.3
        assert group.tme_mm is not None and 0 < group.tme_mm < 15
        assert group.kept_share > 0.9 and group.seconds_per_frame > 0
    assert (arc.scale_stated, pan.scale_stated) == (1, 0)
    assert arc.abs_scale_error_percent is not None and pan.abs_scale_error_percent is None
    assert floor.seed is None and floor.recipe["recipe"] == "threedpw"


def test_the_table_is_printed(place):
    said = (place / "said.txt").read_text(encoding="utf-8")
    for text in ("OME [deg]", "arc_00", "all panning", "2/2 right"):
        assert text in said
    assert said.rstrip().endswith("floor.json")


def test_the_same_again_is_the_same_file_and_a_broken_sequence_is_a_row(place, filmed_set):
    path = place / "out" / "floor.json"
    before, was = path.read_bytes(), Floor.read(path)
    main(words(place))
    assert path.read_bytes() == before
    root = place / "twins" / "3DPW"
    pickle_path = root / "sequenceFiles" / "train" / "pan_00.pkl"
    broken = pickle_path.with_name("torn_00.pkl")
    broken.write_bytes(pickle_path.read_bytes()[:200])
    shutil.copytree(root / "imageFiles" / "pan_00", root / "imageFiles" / "torn_00")
    for true in filmed_set.truth["pan_00"]:
        rest_pelvis_m = read_body(filmed_set.body_path).rest_pelvis_m(true.motion.shape)
        save_clip(place / "twins" / "truth" / "torn_00.p0.npz", true, rest_pelvis_m)
    index = place / "twins" / "truth" / "twins.json"
    sequences = (*TwinsRecord.read(index).sequences, twin("torn_00", "panning", 1))
    TwinsRecord(sequences=sequences).write(index)
    answer = floor_verb(place)
    assert answer.returncode == 1 and "torn_00" in answer.stderr
    assert "Traceback" not in answer.stderr and "torn_00: rejected: " in answer.stdout
    floor = Floor.read(path)
    torn = next(row for row in floor.sequences if row.id == "torn_00")
    assert (torn.accepted, torn.class_measured, torn.tme_mm) == (False, "none", None)
    assert floor.classes["circular"] == was.classes["circular"]
    panning = floor.classes["panning"]
    assert panning.tme_mm == was.classes["panning"].tme_mm
    assert (panning.sequences, panning.accepted) == (2, 1)
    assert panning.kept_share == pytest.approx(was.classes["panning"].kept_share / 2, rel=1e-5)


def test_other_twins_are_measured_in_the_same_folder_with_redo(place, tmp_path):
    """They were refused with it too, as those that are gone were listed there."""
    folder = Path(shutil.copytree(place, tmp_path / "place"))
    root, index = folder / "twins" / "3DPW", folder / "twins" / "truth" / "twins.json"
    (root / "sequenceFiles" / "train" / "pan_00.pkl").unlink()
    (root / "sequenceFiles" / "train" / "torn_00.pkl").unlink(missing_ok=True)
    TwinsRecord(sequences=(twin("arc_00", "circular", 2),)).write(index)
    with pytest.raises(BadManifest, match=r"lists pan_00 besides.*Leave it out with --redo"):
        measure_floor(folder / "twins", folder / "out", folder / "recipe.yaml")
    main(words(folder, "--redo"))
    assert [row.id for row in Floor.read(folder / "out" / "floor.json").sequences] == ["arc_00"]


def test_twins_without_truth_are_refused_before_the_work(filmed_set, tmp_path):
    recipe = filmed_set.recipe()
    with pytest.raises(MissingInput, match=r"twins\.json"):
        floor_of_twins(tmp_path / "twins", recipe, tmp_path / "out")
    write_truth(filmed_set, tmp_path / "twins")
    (tmp_path / "twins" / "truth" / "pan_00.p0.npz").unlink()
    with pytest.raises(MissingInput, match=r"no pan_00\.p0\.npz"):
        floor_of_twins(tmp_path / "twins", recipe, tmp_path / "out")
    unknown = recipe.model_copy(update={"sequences": ("more_00",)})
    with pytest.raises(MissingInput, match="no twin 'more_00'; there are arc_00, pan_00"):
        floor_of_twins(tmp_path / "twins", unknown, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_where_nothing_is_regenerated_the_reason_is_said_and_the_old_floor_stays(
    place, tmp_path, no_scheduler
):
    """It was written anew, with another recipe beside the figures of the run before."""
    shutil.copytree(place, tmp_path / "place")
    twins_dir, out = tmp_path / "place" / "twins", tmp_path / "place" / "out"
    recipe = load_recipe(tmp_path / "place" / "recipe.yaml", ThreedpwRecipe)
    before = (out / "floor.json").read_bytes()
    sfm = recipe.sequence.sfm.model_copy(update={"seed": 7})
    other = recipe.model_copy(update={"sequence": recipe.sequence.model_copy(update={"sfm": sfm})})
    with pytest.raises(NothingMade, match=r"(?s)of \d failed.*arc_00: .*--redo"):
        floor_of_twins(twins_dir, other, out)
    assert (out / "floor.json").read_bytes() == before
    shutil.rmtree(out / "regenerated" / "sequences" / "arc_00" / "pseudo_gt")
    with pytest.raises(NothingMade, match=f"no Dask scheduler at {no_scheduler}"):
        floor_of_twins(twins_dir, recipe, out, run=Run(scheduler=no_scheduler))
    assert (out / "floor.json").read_bytes() == before


def test_a_sequence_that_fails_now_has_no_figures_of_the_run_before(place, tmp_path):
    shutil.copytree(place / "out", tmp_path / "out")
    regenerated, twins = tmp_path / "out" / "regenerated", read_truth(place / "twins")
    recipe = load_recipe(place / "recipe.yaml", ThreedpwRecipe)
    arc = next(one for one in measure(twins, regenerated, recipe).sequences if one.id == "arc_00")
    assert arc.people[0].kept_frames > 0
    (regenerated / "failed").mkdir(exist_ok=True)
    (regenerated / "failed" / "arc_00.txt").write_text("made with other values", encoding="utf-8")
    arc = next(one for one in measure(twins, regenerated, recipe).sequences if one.id == "arc_00")
    assert arc.people[0].kept_frames == 0 and arc.tme_mm is None


def test_a_body_that_the_recipe_lacks_is_named(place, filmed_set):
    twins = read_truth(place / "twins")
    none_named = filmed_set.recipe().model_copy(update={"bodies": ()})
    with pytest.raises(BadBodyFile, match="which is not among the recipe's"):
        measure(twins, place / "out" / "regenerated", none_named)


@pytest.mark.parametrize("old", [False, True])
def test_where_no_twin_is_rendered_the_reason_is_said_and_old_ones_stay(
    filmed_set, tmp_path, no_scheduler, old
):
    """Another seed's twins were measured and listed with this one, or said to be missing."""
    clip = {"id": "walk_00", "gait": "walk", "programme": {"kind": "static"}}
    film = {"fps_hz": 30, "duration_s": 0.5, "width_px": 96, "height_px": 64}
    twins = {"recipe": "synthetic", "name": "none", "clips": [clip], "film": film}
    recipe = TwinRecipe.model_validate({"recipe": "threedpw_twin", "set": twins})
    out = tmp_path / "out"
    if old:
        shutil.copytree(filmed_set.root, out / "twins" / "3DPW")
        write_truth(filmed_set, out / "twins")
        (out / "floor.json").write_text("old", encoding="utf-8")
    with pytest.raises(NothingMade, match=f"no Dask scheduler at {no_scheduler}"):
        sampled_floor(recipe, tmp_path, filmed_set.recipe(), out, run=Run(scheduler=no_scheduler))
    assert not (out / "regenerated").exists()
    assert [path.read_text(encoding="utf-8") for path in out.glob("floor.json")] == ["old"] * old
