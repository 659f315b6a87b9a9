"""Which clips are trained on: by subject, by published lists, by weights."""

from collections.abc import Callable
from dataclasses import replace
from itertools import groupby
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gmrdata.gmr.config import DataConfig
from gmrdata.gmr.runs import cmu_trial, recording_of, split_manifests, subject_of
from gmrdata.gmr.train import GmrRecipe, train
from gmrdata.manifest.current import Quality, Source
from gmrdata.manifest.read import read_manifest
from gmrdata.motion.amass import amass_rate
from gmrdata.motion.library import library_files
from gmrdata.read.body_file import save_body
from gmrdata.read.source_motion import is_trial
from gmrdata.stage import recipes
from gmrdata.values.errors import BadManifest, BadRecipe, MissingInput
from gmrdata.values.files import read_json, read_npz
from tests.clip_manifests import write_clips
from tests.docs.page_commands import commands

CMU_02_03 = Source(dataset="CMU", sequence="02_03")
SOURCES = {
    "02_03": CMU_02_03,
    "02_01": Source(dataset="CMU", sequence="02_01"),
    "AMASS.02_03": Source(dataset="AMASS", sequence="CMU/02/02_03_poses"),
    "AMASS.08_99": Source(dataset="AMASS", sequence="CMU/08/08_99_stageii"),
    "kick": Source(dataset="AMASS", sequence="KIT/3/kick_poses"),
    "gait": Source(dataset="gmrdata", sequence="02_03"),
    "file": Source(dataset="file", sequence="02_03_poses"),
    "plain": Source(dataset="file", sequence="jump"),
}


@pytest.fixture
def make_manifest(make_clips, small_body, tmp_path) -> Callable[..., Path]:
    """A manifest of small clips with these sources."""

    def make(name: str, sources: dict[str, Source] = SOURCES) -> Path:
        clips = make_clips(len(sources), len(name), duration_s=2.0)
        named = [replace(clip, id=id) for id, clip in zip(sources, clips, strict=True)]
        return write_clips(tmp_path / name, small_body, named, sources=sources)

    return make


def test_subjects_and_trials():
    assert {name: (subject_of(s), cmu_trial(s)) for name, s in SOURCES.items()} == {
        "02_03": ("CMU/02", "02_03"),
        "02_01": ("CMU/02", "02_01"),
        "AMASS.02_03": ("CMU/02", "02_03"),
        "AMASS.08_99": ("CMU/08", "08_99"),
        "kick": ("KIT/3", None),
        "gait": (None, None),
        "file": ("CMU/02", "02_03"),
        "plain": (None, None),
    }
    assert subject_of(Source(dataset="Human3.6M", sequence="S9/Walking/1")) == "Human3.6M/S9"
    assert subject_of(Source(dataset="EMDB", sequence="P0/09_outdoor_walk")) == "EMDB/P0"
    assert subject_of(Source(dataset="AMASS", sequence="SFU/0005/0005_Walk001_poses")) == "SFU/0005"
    here = Source(dataset="file", sequence=".")  # a path without parts, which was a traceback
    assert (subject_of(here), cmu_trial(here), recording_of(here)) == (None, None, None)


@given(subject=st.integers(1, 144), trial=st.integers(1, 75))
def test_every_form_of_a_trial_is_that_trial(subject, trial):
    name = f"{subject:02d}_{trial:02d}"
    forms = [
        Source(dataset="CMU", sequence=name),
        Source(dataset="file", sequence=name),
        Source(dataset="AMASS", sequence=f"CMU/{subject:02d}/{name}_poses"),
        Source(dataset="AMASS", sequence=f"CMU/{subject:02d}/{name}_stageii"),
        # As AMASS was unpacked elsewhere, which was trained on, Table 8 or not.
        Source(dataset="AMASS", sequence=f"AMASS/CMU/{name}_poses"),
        Source(dataset="AMASS", sequence=f"cmu/{subject:02d}/{name}_poses"),
        Source(dataset="AMASS", sequence=f"CMU_SMPLH/{subject:02d}/{name}_poses"),
        # As a clip's file is exported.
        Source(dataset="file", sequence=f"{subject:02d}.{name}_poses_00000-00099"),
    ]
    assert {cmu_trial(form) for form in forms} == {name}
    assert {subject_of(form) for form in forms} == {f"CMU/{subject:02d}"}
    assert cmu_trial(Source(dataset="AMASS", sequence=f"KIT/3/{name}_poses")) is None


@pytest.mark.parametrize(
    ("folder", "link", "data_set"),
    [
        ("CMU", "CMU", "CMU"),
        ("cmu_smplh", "cmu_smplh", "cmu_smplh"),
        ("CMUmocap", "CMUmocap", "CMUmocap"),  # was read at twice its speed
        ("CMU/smplh", "CMU/smplh", "CMU"),  # was trained on, of Table 8 or not, as were these two
        ("CMU_2", "link", "CMU_2"),
        ("store", "CMU_2", "CMU"),
        ("KIT", "KIT", "KIT"),
    ],
)
def test_a_folder_of_cmu_is_one_to_its_rate_its_source_and_a_split(
    tmp_path, folder, link, data_set
):
    """There were three rules of what such a folder is."""
    path = tmp_path / folder / "62" / "62_11_poses.npz"
    path.parent.mkdir(parents=True)
    np.savez(path, poses=np.zeros((6, 72)), trans=np.zeros((6, 3)), mocap_framerate=120.0)
    if link != folder:
        (tmp_path / link).symlink_to(tmp_path / folder)
    (file,) = library_files((tmp_path / link,))
    assert file.source == Source(dataset="AMASS", sequence=f"{data_set}/62/62_11_poses")
    rate_hz, rate_from = amass_rate(read_npz(file.path), None, file.path)
    known = ("62_11", 60.0, "CMU's index") if data_set != "KIT" else (None, 120.0, "file")
    assert (cmu_trial(file.source), rate_hz, rate_from) == known


def test_a_recording_is_known_in_each_form_and_nothing_else_is_taken_for_one():
    assert {name: recording_of(source) for name, source in SOURCES.items()} == {
        "02_03": ("CMU", "02_03"),
        "02_01": ("CMU", "02_01"),
        "AMASS.02_03": ("CMU", "02_03"),
        "AMASS.08_99": ("CMU", "08_99"),
        "kick": ("AMASS", "KIT/3/kick"),
        "gait": None,
        "file": ("CMU", "02_03"),
        "plain": None,
    }
    assert recording_of(Source(dataset="AMASS", sequence="KIT/3/kick_stageii")) == (
        "AMASS",
        "KIT/3/kick",
    )


def test_a_held_out_clip_is_not_scored_where_its_recording_is_trained_on(
    make_manifest, small_body, small_config, tmp_path, capsys
):
    """Other arrays of the same recording were scored, and chose the weights; walkers and files of
    one name are not of one recording."""
    known = ("02_01", "kick", "gait", "plain")
    training = make_manifest("all", {name: SOURCES[name] for name in known})
    other_forms = {
        "a": Source(dataset="AMASS", sequence="CMU/02/02_01_poses"),
        "b": Source(dataset="AMASS", sequence="KIT/3/kick_stageii"),
    }
    unlike = {"c": SOURCES["gait"], "d": SOURCES["plain"]}
    held_out = make_manifest("others", other_forms | unlike)
    save_body(tmp_path / "body.npz", small_body)
    paths = {"body_path": tmp_path / "body.npz", "held_out_paths": [held_out]}
    train([training], tmp_path / "run", small_config, **paths)
    assert "not scored: 2 of 4 held-out clips are trained on" in capsys.readouterr().err


def test_trials_of_table_8_are_left_out_by_default(make_manifest):
    split = split_manifests([make_manifest("all")], DataConfig())
    assert [file.entry.id for file in split.training] == [
        "02_01",
        "AMASS.08_99",
        "gait",
        "kick",
        "plain",
    ]
    assert split.left_out == {"on the list paper_table8": 3}
    assert split.statement == "not trained on: 3 of 8 clips (3 on the list paper_table8)"
    assert split.held_out == ()
    everything = split_manifests([make_manifest("all")], DataConfig(never_train_on=()))
    assert len(everything.training) == 8 and everything.statement == ""


def test_all_50_rows_of_table_8_are_left_out(make_manifest):
    """Each of the 50 trials, in AMASS's form."""
    rows = read_manifest(recipes.published_manifest("paper_table8")).clips
    trials = sorted({row.source.sequence for row in rows})
    assert len(trials) == 50
    sources = {
        f"t{trial}": Source(dataset="AMASS", sequence=f"CMU/{trial[:2]}/{trial}_poses")
        for trial in trials
    }
    split = split_manifests([make_manifest("t8", sources), make_manifest("all")], DataConfig())
    assert split.left_out == {"on the list paper_table8": 53}
    assert split.mix.sizes == (0, 5)


def test_held_out_subjects_are_scored_and_not_trained_on(make_manifest):
    path = make_manifest("all")
    for subjects in ((2, "KIT/3"), ("02", "KIT/3"), ("CMU/02", "KIT/3")):
        split = split_manifests([path], DataConfig(held_out_subjects=subjects))
        assert [file.entry.id for file in split.training] == ["AMASS.08_99", "gait", "plain"]
        assert [file.entry.id for file in split.held_out] == [
            "02_01",
            "02_03",
            "AMASS.02_03",
            "file",
            "kick",
        ]
        assert sum(split.left_out.values()) == 5
    with pytest.raises(BadRecipe, match="no clip is of 77"):
        split_manifests([path], DataConfig(held_out_subjects=(2, 77)))


def test_what_can_not_be_split_is_said(make_manifest):
    path = make_manifest("one", {"02_03": CMU_02_03})
    held_out = DataConfig(never_train_on=(), held_out_subjects=(2,))
    for data, reason in (
        (DataConfig(), "on the list paper_table8"),
        (held_out, "of held-out .* 2"),
    ):
        remedy = r"Give others, or change data\.never_train_on or data\.held_out_subjects"
        with pytest.raises(BadManifest, match=rf"1 of 1 clips \(1 {reason}\)\)\. {remedy}$"):
            split_manifests([path], data)
    only = split_manifests([path], held_out, to_train=False)
    assert ([file.entry.id for file in only.held_out], only.training) == (["02_03"], ())
    with pytest.raises(MissingInput, match="table9: no such published manifest"):
        split_manifests([path], DataConfig(never_train_on=("table9",)))
    with pytest.raises(BadRecipe, match="has 2 weights for 1 manifests"):
        split_manifests([path], DataConfig(weights=(1.0, 2.0)))


@pytest.mark.parametrize("recipe", ["gmr", "gmr_cmu", "gmr_bundled"])
def test_the_trials_that_a_page_fetches_are_trained_on(recipe, make_manifest):
    """No recipe trains on Table 8's, and two hold out subjects who have to be there."""
    data = recipes.load_recipe(recipes.find_recipe(recipe), GmrRecipe).train.data
    (fetch,) = (one.arguments for one in commands() if one.arguments[:2] == ("fetch", "cmu"))
    sources = {trial: Source(dataset="CMU", sequence=trial) for trial in fetch if is_trial(trial)}
    split = split_manifests([make_manifest("page", sources)], data)
    assert len(split.training) >= 3


def test_a_training_says_what_it_left_out(
    make_manifest, small_body, small_config, tmp_path, capsys
):
    """Two manifests with weights, a held-out subject that is scored, and Table 8's trials out."""
    save_body(tmp_path / "body.npz", small_body)
    paths = [make_manifest("all"), make_manifest("more", {"walk": SOURCES["plain"]})]
    data = DataConfig(weights=(1.0, 3.0), held_out_subjects=("KIT/3",))
    config = small_config.model_copy(update={"data": data})
    train(paths, tmp_path / "run", config, body_path=tmp_path / "body.npz")
    record = read_json(tmp_path / "run" / "stage.json")["facts"]
    assert record["clips"] == 5
    assert record["left_out"] == {"of held-out subject KIT/3": 1, "on the list paper_table8": 3}
    assert "not trained on: 4 of 9 clips" in " ".join(capsys.readouterr().err.split())
    assert "held_out_tme_mm" in (tmp_path / "run" / "metrics.jsonl").read_text()
    assert not (tmp_path / "run" / "pack").exists()


def test_people_come_one_after_the_other_where_they_are_balanced(make_manifest):
    paths = [make_manifest("a"), make_manifest("b", {"plain": SOURCES["plain"]})]
    kept = DataConfig(never_train_on=())
    split = split_manifests(paths, kept)
    assert split.mix.sizes == (8, 1) and split.mix.manifests == (0, 1)
    balanced = split_manifests(paths, kept.model_copy(update={"balance": 0.5}))
    people = [subject_of(file.entry.source) for file in balanced.training[:8]]
    in_a_row = [(person, len(list(files))) for person, files in groupby(people)]
    assert dict(in_a_row) == {"CMU/02": 4, "CMU/08": 1, "KIT/3": 1, None: 2} and len(in_a_row) == 4
    assert balanced.mix.sizes == (*(n for _, n in in_a_row), 1)
    assert balanced.mix.manifests == (0, 0, 0, 0, 1) and balanced.mix.balance == 0.5
    assert balanced.mix.sizes_of_manifests == (8, 1)
    nobody = "data.balance: 3 of 9 clips name nobody, and count as one person's"
    assert balanced.statement == nobody and split.statement == ""
    assert {file.entry.id for file in balanced.training} == {
        file.entry.id for file in split.training
    }


def test_no_manifest_is_no_clip():
    with pytest.raises(BadManifest, match="no usable clips"):
        split_manifests([], DataConfig())


def test_clips_that_nobody_can_use_are_counted(make_clips, small_body, tmp_path):
    """They were neither trained on nor said to be left out: 1 of 3 clips was all of them."""
    clips = make_clips(3, 1)
    clips[2] = replace(clips[2], valid=np.zeros(clips[2].motion.n_frames, dtype=bool))
    rejected = {clips[1].id: Quality(verdict="rejected", reasons=("drift",))}
    path = write_clips(tmp_path / "data", small_body, clips, rejected)
    split = split_manifests([path], DataConfig())
    assert [file.entry.id for file in split.training] == [clips[0].id]
    said = "not trained on: 2 of 3 clips (1 rejected, 1 without a valid frame)"
    assert split.statement == said
    assert split.left_out == {"rejected": 1, "without a valid frame": 1}
