"""From 3DPW's layout to a manifest of world motions, with verdicts, on real workers."""

import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from gmrdata.manifest.check import check_manifest
from gmrdata.manifest.read import read_manifest
from gmrdata.manifest.write import manifest_text
from gmrdata.pages.batches import write_set_pages
from gmrdata.read.threedpw_files import SequenceFiles
from gmrdata.stage import workers
from gmrdata.stage.jobs import Outcome
from gmrdata.stage.run import Run, Shard
from gmrdata.threedpw import regenerate
from gmrdata.threedpw.recipe import SetPaths, ThreedpwRecipe
from gmrdata.threedpw.regenerate import plan, regenerate_set
from gmrdata.twins.pseudo_gt_error import compare_clips
from gmrdata.values.clip import load_clip
from gmrdata.values.errors import (
    BadManifest,
    BadRecipe,
    MissingInput,
    NothingMade,
    StageFailed,
)
from gmrdata.values.files import read_json
from tests.film.set_kills import contents

pytestmark = pytest.mark.slow


def clip_path(out_dir: Path, name: str, person: int) -> Path:
    return out_dir / "sequences" / name / "pseudo_gt" / f"person_{person}.npz"


def test_every_sequence_has_a_verdict_and_the_manifest_is_good(made_set):
    rows = {row["sequence"]: row for row in read_json(made_set / "verdicts.json")["sequences"]}
    assert rows["arc_00"]["accepted"] and rows["arc_00"]["camera_motion"] == "circular"
    assert rows["pan_00"]["accepted"] and rows["pan_00"]["camera_motion"] == "panning"
    assert rows["pan_00"]["scale"] is None and rows["arc_00"]["scale"] > 0
    check_manifest(made_set / "pseudo_gt.yaml")
    manifest = read_manifest(made_set / "pseudo_gt.yaml")
    assert [clip.id for clip in manifest.clips] == ["arc_00.p0", "arc_00.p1", "pan_00.p0"]
    for clip in manifest.clips:
        assert clip.quality is not None and clip.quality.verdict == "accepted"
        assert clip.quality.figures["kept_share"] > 0.9


def test_two_people_share_one_right_world(made_set, filmed_set):
    found = [load_clip(clip_path(made_set, "arc_00", person)) for person in (0, 1)]
    true = filmed_set.truth["arc_00"]
    for pseudo, exact in zip(found, true, strict=True):
        error = compare_clips(pseudo, exact, fps_hz=10.0)
        assert error.ome_deg < 0.3 and error.tme_mm < 15
    # One world: the people are as far apart as they were.
    apart_m = np.linalg.norm(found[0].motion.pelvis_m - found[1].motion.pelvis_m, axis=1)
    true_m = np.linalg.norm(true[0].motion.pelvis_m - true[1].motion.pelvis_m, axis=1)
    assert np.abs(apart_m - true_m).max() < 0.05
    assert np.array_equal(found[0].camera.world_from_cam, found[1].camera.world_from_cam)


@pytest.fixture(scope="module")
def made_by_two(filmed_set, tmp_path_factory) -> Path:
    """The same by two workers, for the tests that run it again."""
    out_dir = tmp_path_factory.mktemp("two") / "out"
    regenerate_set(filmed_set.recipe(workers=2), filmed_set.root, out_dir)
    write_set_pages(filmed_set.recipe(workers=2), filmed_set.root, out_dir)
    return out_dir


def test_two_workers_make_the_same_bytes(made_set, made_by_two):
    pages = ["index.html", "qa/arc_00.html", "qa/pan_00.html"]
    for path in ["pseudo_gt.yaml", "verdicts.json", *pages]:
        assert (made_by_two / path).read_bytes() == (made_set / path).read_bytes()
    for path in sorted((made_set / "sequences").rglob("*.npz")):
        other = made_by_two / path.relative_to(made_set)
        assert other.read_bytes() == path.read_bytes(), path


def test_a_second_run_does_nothing_and_a_dry_run_says_so(made_by_two, filmed_set):
    recipe = filmed_set.recipe(workers=2)
    before = {path: path.stat().st_mtime_ns for path in (made_by_two / "sequences").rglob("*")}
    written = ["pseudo_gt.yaml", "index.html", "qa/arc_00.html", "qa/pan_00.html"]
    contents = [(made_by_two / path).read_bytes() for path in written]
    regenerate_set(recipe, filmed_set.root, made_by_two)
    write_set_pages(recipe, filmed_set.root, made_by_two)
    after = {path: path.stat().st_mtime_ns for path in (made_by_two / "sequences").rglob("*.npz")}
    assert all(before[path] == time for path, time in after.items())
    assert [(made_by_two / path).read_bytes() for path in written] == contents
    rows = plan(recipe, filmed_set.root, made_by_two)
    assert [row[2] for row in rows] == ["done", "done"]
    sfm = recipe.sequence.sfm.model_copy(update={"seed": 5})
    other = recipe.model_copy(update={"sequence": recipe.sequence.model_copy(update={"sfm": sfm})})
    for row in plan(other, filmed_set.root, made_by_two):
        assert "/sfm: made with other values of config.sfm.seed. Pass --redo" in row[2]
    rows = plan(other, filmed_set.root, made_by_two, run=Run(redo=True))
    assert [row[2] for row in rows] == ["to do: again", "to do: again"]
    assert {path: path.stat().st_mtime_ns for path in after} == after


def test_a_rerun_without_a_change_starts_no_worker_and_draws_no_page(
    made_by_two, filmed_set, monkeypatch, capsys
):
    recipe = filmed_set.recipe(workers=2)
    monkeypatch.delattr(workers, "_local_client")
    pages = {path: path.stat().st_mtime_ns for path in made_by_two.rglob("*.html")}
    regenerate_set(recipe, filmed_set.root, made_by_two)
    write_set_pages(recipe, filmed_set.root, made_by_two)
    assert "nothing changed: 2 sequences are as they were made" in capsys.readouterr().err
    assert pages and {path: path.stat().st_mtime_ns for path in pages} == pages


def test_bad_sequences_do_not_stop_the_others(copied_set, tmp_path):
    arc, pan = (copied_set.root / "sequenceFiles" / "train" / f"{n}_00.pkl" for n in ("arc", "pan"))
    truncated = arc.with_name("torn_00.pkl")
    truncated.write_bytes(arc.read_bytes()[:2000])
    hostile = arc.with_name("evil_00.pkl")
    hostile.write_bytes(b"cposix\nsystem\n(S'touch " + str(tmp_path / "owned").encode() + b"'\ntR.")
    images = copied_set.root / "imageFiles"
    (images / "arc_00" / "image_00020.jpg").unlink()
    (images / "arc_00" / "image_00007.jpg").write_bytes(b"")
    # Nobody has a row there, and so no mask.
    shutil.copy(images / "arc_00" / "image_00035.jpg", images / "arc_00" / "image_00036.jpg")
    paint_grey(images / "pan_00")
    assert pan.is_file()
    out_dir = tmp_path / "out"
    with pytest.raises(StageFailed, match="2 of 4 failed") as caught:
        regenerate_set(copied_set.recipe(), copied_set.root, out_dir)
    assert "torn_00" in str(caught.value) and "evil_00" in str(caught.value)
    assert not (tmp_path / "owned").exists()
    rows = {row["sequence"]: row for row in read_json(out_dir / "verdicts.json")["sequences"]}
    assert rows["arc_00"]["accepted"]
    assert not rows["evil_00"]["accepted"] and "posix.system" in rows["evil_00"]["reasons"][0]
    why = "0 features per frame outside the masks: the background is textureless"
    assert not rows["pan_00"]["accepted"] and rows["pan_00"]["reasons"][0].startswith(why)
    manifest = read_manifest(out_dir / "pseudo_gt.yaml")
    check_manifest(out_dir / "pseudo_gt.yaml")
    assert str(copied_set.root) not in (out_dir / "pseudo_gt.yaml").read_text()
    by_id = {clip.id: clip for clip in manifest.clips}
    dropped = {run.start: run for run in by_id["arc_00.p0"].dropped}
    assert "empty (0 bytes)" in dropped[7].reason and dropped[7].stop == 8
    assert "missing" in dropped[20].reason and dropped[20].stop == 21
    assert by_id["pan_00.p0"].kept == () and by_id["pan_00.p0"].camera_motion == "none"
    # Each has a page with its reason, and what there is of it.
    write_set_pages(copied_set.recipe(), copied_set.root, out_dir)
    pages = {name: (out_dir / "qa" / f"{name}.html").read_text() for name in rows}
    assert "posix.system" in pages["evil_00"] and "failed/evil_00.txt" in pages["evil_00"]
    assert "textureless" in pages["pan_00"] and "there is no reconstruction (36)" in pages["pan_00"]
    assert "image_00007.jpg is empty (0 bytes) (2)" in pages["arc_00"]
    # What has no reconstruction is not tried again.
    stage = out_dir / "sequences" / "pan_00" / "pseudo_gt" / "stage.json"
    before = stage.stat().st_mtime_ns
    regenerate_set(
        copied_set.recipe(sequences=["pan_00"]), copied_set.root, out_dir, run=Run(redo=True)
    )
    assert stage.stat().st_mtime_ns == before


@pytest.mark.parametrize("redo", [False, True])
def test_one_sequence_again_does_not_take_the_place_of_all(
    made_set, filmed_set, tmp_path, capsys, redo
):
    """The manifest then listed that one alone, in silence; its page was the only one with frames.
    It is complete again when the last that had failed is made."""
    out_dir = Path(shutil.copytree(made_set, tmp_path / "out"))
    names = ("pseudo_gt.yaml", "verdicts.json", "index.html", "qa/arc_00.html")
    manifest, before = out_dir / names[0], [(out_dir / name).read_bytes() for name in names]
    alone = filmed_set.recipe(sequences=["pan_00"])
    manifest.write_text(manifest.read_text().replace("1.0.0", "1.0.0-incomplete", 1))
    regenerate_set(alone, filmed_set.root, out_dir, run=Run(redo=redo))
    write_set_pages(alone, filmed_set.root, out_dir)
    assert [(out_dir / name).read_bytes() for name in names] == before
    regenerate_set(alone, filmed_set.root, out_dir, run=Run(redo=redo))
    assert "nothing changed" in capsys.readouterr().err


def test_one_sequence_again_is_of_the_settings_of_all(made_set, filmed_set, tmp_path):
    """Or it is refused, before anything is made."""
    out_dir = Path(shutil.copytree(made_set, tmp_path / "out"))
    sequence = filmed_set.recipe().sequence
    sfm = sequence.sfm.model_copy(update={"seed": 5})
    alone = filmed_set.recipe(sequences=["pan_00"])
    other = alone.model_copy(update={"sequence": sequence.model_copy(update={"sfm": sfm})})
    left = contents(out_dir)
    said = r"lists arc_00 besides.*values of config\.sfm\.seed\)\. Name no sequences"
    for job in (plan, regenerate_set):
        with pytest.raises(BadManifest, match=said):
            job(other, filmed_set.root, out_dir, run=Run(redo=True))
    assert contents(out_dir) == left
    # What is gone and was listed is not forgotten either; what had failed is.
    shutil.rmtree(out_dir / "sequences" / "arc_00" / "pseudo_gt")
    with pytest.raises(BadManifest, match="lists arc_00 besides"):
        regenerate_set(alone, filmed_set.root, out_dir)
    entries = read_manifest(out_dir / "pseudo_gt.yaml")
    (out_dir / "pseudo_gt.yaml").write_text(
        manifest_text(entries.model_copy(update={"clips": entries.clips[2:]}))
    )
    regenerate_set(other, filmed_set.root, out_dir, run=Run(redo=True))
    manifest = read_manifest(out_dir / "pseudo_gt.yaml")
    assert [clip.id for clip in manifest.clips] == ["pan_00.p0"]
    assert manifest.version == "1.0.0-incomplete"
    (arc, _) = read_json(out_dir / "verdicts.json")["sequences"]
    assert arc["reasons"] == ["not made with these settings"]


def paint_grey(image_dir: Path) -> None:
    """Nothing is left of which cameras could be found."""
    grey = cv2.imencode(".jpg", np.full((180, 320, 3), 120, np.uint8))[1].tobytes()
    for path in image_dir.glob("*.jpg"):
        path.write_bytes(grey)


def test_without_a_reconstruction_a_persons_decision_stands_too(copied_set, tmp_path):
    paint_grey(copied_set.root / "imageFiles" / "pan_00")

    def verdict(**decided: Any) -> dict[str, Any]:
        overrides = {"pan_00": {"because": "a glass wall", **decided}}
        recipe = copied_set.recipe(sequences=["pan_00"], overrides=overrides)
        regenerate_set(recipe, copied_set.root, tmp_path / "out", run=Run(redo=True))
        return read_json(tmp_path / "out" / "verdicts.json")["sequences"][0]

    for decided in ("rejected", "accepted"):
        found = verdict(verdict=decided)
        assert not found["accepted"] and found["reasons"][0] == "a person decided: a glass wall"
        assert "textureless" in found["reasons"][1]
    assert found["reasons"][2] == "no frame can be used"
    (clip,) = read_manifest(tmp_path / "out" / "pseudo_gt.yaml").clips
    assert clip.quality is not None and "a glass wall" in clip.quality.reasons[0]
    with pytest.raises(StageFailed, match=r"drop 0\.\.37: the sequence has 36 frames"):
        verdict(drop=[[0, 37]])


def test_without_a_reconstruction_other_masks_are_tried(copied_set, tmp_path):
    pan, masks = copied_set.root / "imageFiles" / "pan_00", tmp_path / "masks"
    masks.mkdir()
    for path in sorted(pan.glob("*.jpg")):
        cv2.imwrite(str(masks / f"{path.stem}.png"), np.full((180, 320), 255, np.uint8))
    source = {"kind": "folder", "path": str(masks)}
    sequence = {"masks": {"sources": [source]}, "sfm": {"max_features": 800}}
    recipe = copied_set.recipe(sequence=sequence, sequences=["pan_00"])
    out_dir = tmp_path / "out"
    regenerate_set(recipe, copied_set.root, out_dir)
    assert "masks" in read_json(out_dir / "verdicts.json")["sequences"][0]["reasons"][0]
    for path in masks.iterdir():
        cv2.imwrite(str(path), np.zeros((180, 320), np.uint8))
    with pytest.raises(StageFailed, match="other values of inputs"):
        regenerate_set(recipe, copied_set.root, out_dir)
    regenerate_set(recipe, copied_set.root, out_dir, run=Run(redo=True))
    assert read_json(out_dir / "verdicts.json")["sequences"][0]["accepted"]
    # Images of all sequences have the same names.
    with pytest.raises(BadRecipe, match="a folder of masks is of one sequence"):
        regenerate_set(copied_set.recipe(sequence=sequence), copied_set.root, tmp_path / "both")


def test_a_decision_on_a_sequence_that_is_not_there_is_named(filmed_set, capsys):
    overrides = {"arc_0": {"verdict": "rejected", "because": "drifts"}}
    recipe = filmed_set.recipe(overrides=overrides, sequences=["nobody"])
    regenerate._require_fitting(recipe, filmed_set.root, 1)
    assert "overrides of arc_0" in " ".join(capsys.readouterr().err.split())


@pytest.fixture
def listed(tmp_path, monkeypatch) -> Callable[..., tuple[bytes, bytes]]:
    """Lists sequences of a set of two, arc_00 and pan_00; gives the manifest and the verdicts."""
    monkeypatch.setattr(
        regenerate, "_verdict", lambda one, _: regenerate._failed(one.name, "", "no")
    )
    monkeypatch.setattr(regenerate, "sequence_entries", lambda *_: [])
    paths, recipe = SetPaths(tmp_path), ThreedpwRecipe(recipe="threedpw")

    def make(*names: str, reasons: Mapping[str, str] | None = None, **changed: Any) -> Any:
        files = [SequenceFiles(tmp_path, name, "train") for name in names]
        regenerate._list(recipe.model_copy(update=changed), files, reasons or {}, paths, Run())
        return paths.manifest.read_bytes(), paths.verdicts.read_bytes()

    return make


def test_a_manifest_that_is_refused_leaves_the_verdicts_as_they_were(tmp_path, listed):
    """As `--sequences` does in the folder of the whole set, whose version is out."""
    _, before = listed("arc_00", "pan_00")
    with pytest.raises(BadManifest, match="pass --redo"):
        listed("arc_00", sequences=("arc_00",))
    assert SetPaths(tmp_path).verdicts.read_bytes() == before


def test_where_a_sequence_fails_a_complete_manifest_stays(listed):
    manifest, _ = listed("arc_00", "pan_00")
    after, verdicts = listed("arc_00", "pan_00", reasons={"pan_00": "made with other values"})
    assert after == manifest and b"made with other values" in verdicts
    assert listed("arc_00", "pan_00", reasons={})[0] == manifest


def test_a_share_counts_its_own_stages_alone(filmed_set, tmp_path, monkeypatch):
    """Its bar went on to those of all shares, and said what time these would take."""
    recipe, chosen, _ = regenerate._checked(filmed_set.recipe(), filmed_set.root)
    counted: list[int] = []

    def tried(*given: Any) -> Outcome:
        counted.append(given[-1][0])
        return Outcome({}, {})

    monkeypatch.setattr(regenerate, "try_jobs", tried)
    shards = [Shard(index, 3) for index in (1, 2, 3)]
    for shard in shards:
        regenerate._regenerate([], recipe, chosen, SetPaths(tmp_path), Run(shard=shard))
    own = [sum(shard.of(files.name) == shard.index for files in chosen) for shard in shards]
    assert counted == [5 * n for n in own] and sum(own) == 2


def test_workers_get_absolute_paths(filmed_set, monkeypatch):
    monkeypatch.chdir(filmed_set.root.parent)
    sources = [{"kind": "folder", "path": "masks"}, {"kind": "onnx"}]
    recipe = filmed_set.recipe(sequence={"masks": {"sources": sources}}, sequences=["pan_00"])
    found, (files,), _ = regenerate._checked(recipe, Path("3DPW"))
    assert files.root == filmed_set.root
    masks, onnx = found.sequence.masks.sources
    assert (masks.path, onnx.model) == (filmed_set.root.parent / "masks", None)


def test_a_sequence_that_is_refused_has_its_reason_in_a_file_too(tmp_path, gmrdata):
    """The message named that folder; and a name with escape codes went to the terminal as it is."""
    for path in ("train/a_00", "test/a_00", "test/[red]\x1b[2J", f"test/{'x' * 251}"):
        pickle_path = tmp_path / "3DPW" / "sequenceFiles" / f"{path}.pkl"
        pickle_path.parent.mkdir(parents=True, exist_ok=True)
        pickle_path.write_bytes(b"")
    recipe, out_dir = ThreedpwRecipe(recipe="threedpw"), tmp_path / "out"
    with pytest.raises(NothingMade, match="3 of 3 failed") as caught:
        regenerate_set(recipe, tmp_path / "3DPW", out_dir)
    assert "\x1b" not in str(caught.value)
    (path,) = (out_dir / "failed").iterdir()
    assert path.name == "a_00.txt" and path.read_text().startswith("a_00: is in train and test")
    shown = [row[0] for row in plan(recipe, tmp_path / "3DPW", out_dir)]
    assert shown[:2] == ["a_00", r"'[red]\x1b[2J'"]
    # It showed no verdict, not even of sequences that are made, and no page.
    said = gmrdata("threedpw", "regenerate", "--threedpw", tmp_path / "3DPW", "--out", out_dir)
    assert said.returncode == 1 and "a_00" in said.stdout
    assert said.stdout.splitlines()[-1] == str(out_dir / "index.html")


@pytest.mark.parametrize(("listed", "redo"), [(False, False), (True, False), (True, True)])
def test_a_sequence_of_the_manifest_that_is_gone_is_named(
    tmp_path, monkeypatch, capsys, listed, redo
):
    """All that was said is that there is no such sequence, of which nobody had asked.  --redo was
    refused too, so that the floor of other twins could not be measured in the same folder."""
    train, sequences = tmp_path / "sequenceFiles" / "train", ("arc_00", "pan_00")
    train.mkdir(parents=True)
    (train / "pan_00.pkl").write_bytes(b"")
    clip = SimpleNamespace(id="arc_00.p0", source=SimpleNamespace(sequence="arc_00"))
    there = SimpleNamespace(
        created_by=SimpleNamespace(recipe={"sequences": sequences}), clips=[clip] * listed
    )
    monkeypatch.setattr(regenerate, "_manifest_of", lambda *_: there)
    recipe = ThreedpwRecipe(recipe="threedpw", sequences=("pan_00",))
    paths = SetPaths(tmp_path / "out")
    run = Run(redo=redo)
    if redo:
        assert regenerate._besides(recipe, tmp_path, paths, run) == (recipe, [], {})
        assert "arc_00: left out, as it is not in" in " ".join(capsys.readouterr().err.split())
    elif listed:
        said = r"lists arc_00 besides.*it is not in .* any more\)\. Leave it out with --redo"
        with pytest.raises(BadManifest, match=said):
            regenerate._besides(recipe, tmp_path, paths, run)
    else:
        whole, others, missing = regenerate._besides(recipe, tmp_path, paths, run)
        assert (whole.sequences, others) == (sequences, [])
        assert missing == {"arc_00": f"it is not in {tmp_path} any more"}


def test_a_sequence_that_is_not_there_is_an_error(filmed_set, tmp_path):
    with pytest.raises(MissingInput, match="no sequence nowhere_00"):
        regenerate_set(
            filmed_set.recipe(sequences=["nowhere_00"]), filmed_set.root, tmp_path / "out"
        )
    assert not (tmp_path / "out").exists()


def test_a_dry_run_says_which_stages_are_to_do(filmed_set, gmrdata, tmp_path):
    given = "--threedpw", filmed_set.root, "--out", tmp_path / "out"
    done = gmrdata("threedpw", "regenerate", *given, "--dry-run")
    assert done.returncode == 0
    assert "arc_00" in done.stdout and "to do: people, masks, sfm, lines, pseudo_gt" in done.stdout
    assert not (tmp_path / "out").exists()
