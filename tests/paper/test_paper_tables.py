"""The paper's tables again: what is planned, trained, scored and laid beside the paper's."""

import csv
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gmrdata.cli import main
from gmrdata.gmr.config import DataConfig, LossConfig, NetworkConfig, network_dir
from gmrdata.gmr.predict import load_gmr
from gmrdata.gmr.train import GmrRecipe
from gmrdata.manifest.read import load_clips
from gmrdata.paper.comparison import (
    OverSeeds,
    TableData,
    TableRecord,
    TableRow,
    TrainedOn,
    orderings,
)
from gmrdata.paper.joint import split_videos
from gmrdata.paper.make import (
    _data,
    _record,
    clip_figure,
    held_out_set,
    make_table,
    planned_runs,
    train_one,
)
from gmrdata.paper.plan import (
    Given,
    JointConfig,
    Plan,
    TableRecipe,
    joint_config,
    load_table,
    plan_table,
    train_config,
)
from gmrdata.score.records import PaperMetrics
from gmrdata.stage import recipes
from gmrdata.stage.jobs import Job
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import StageRecord
from gmrdata.values.clip import camera_of, save_clip
from gmrdata.values.errors import (
    BadManifest,
    BadMotionFile,
    BadRecipe,
    MissingInput,
    StageFailed,
)
from gmrdata.values.files import read_json, write_npz
from gmrdata.world.compose import motion_in_camera
from tests.clip_manifests import write_clips
from tests.motions import walking_clips
from tests.paper.openpose_files import person, write_frame, write_frames
from tests.record_keys import assert_each_key_is_needed
from tests.score.score_records import clip_score, metrics
from tests.score.score_records import scores as score_record

TINY = """
recipe: table
table: 2
title: Two losses
paper_data: something larger
scales:
  small:
    note: Tiny.
    seeds: [3]
    train:
      model: {layers: 1, hidden: 8, output_scale: 0.1}
      loss: {n_vertices: 8}
      windows: {frames: 16}
      batch_size: 4
      steps: 4
      eval_every: 1000
rows:
- {name: Chordal, paper: {ome_deg: 1.0, tme_mm: 6.0, vme_mm: 9.0}}
- name: Angular
  train: {loss: {orientation_loss: angular}}
  paper: {ome_deg: 1.5, tme_mm: 7.0, vme_mm: 9.5}
"""


def tiny(folder: Path, old: str = "", new: str = "", more: str = "") -> str:
    """The path of a recipe of a tiny table, with another text in it or more rows."""
    path = folder / "tiny.yaml"
    path.write_text((TINY.replace(old, new) if old else TINY) + more, encoding="utf-8")
    return str(path)


def data_of(recipe: TableRecipe, given: Given) -> TableData:
    """What a table of one scored clip says of its data."""
    overall = score_record([clip_score("02_01", metrics(1.0, 2.0, 3.0))]).overall
    return _data(plan_table(recipe, "small", given), overall)


def test_every_table_of_the_paper_loads():
    names = [name for name in recipes.recipe_names() if name.startswith("paper/")]
    assert names == [f"paper/table{n}" for n in (1, 10, 2, 3, 4, 5, 6, 9)]
    for name in names:
        recipe = load_table(name.removeprefix("paper/table"))
        assert recipe.table == int(name.removeprefix("paper/table"))
        assert recipe.scales.keys() == {"paper", "small"}
    for name in ("7", "8"):  # it was "did you mean 'paper/table9'?"
        with pytest.raises(BadRecipe, match=f"the manifest paper_table{name}.yaml"):
            load_table(name)


@pytest.mark.parametrize(
    ("table", "row", "figures"),
    [
        ("1", "Quaternion / axis-angle", (None, None, 9.46)),
        ("1", "axis-angle / 6D", (None, None, 10.83)),
        ("2", "Chordal", (1.01, 6.82, 9.28)),
        ("3", "V+O", (0.99, 7.05, 9.34)),
        ("3", "V+O+S+T(4/2048)", (0.76, 5.14, 7.01)),
        ("4", "w/ flip augmentation", (0.70, 4.78, 6.47)),
        ("5", "Ours(GT input)", (1.60, 27.55, 29.39)),
        ("6", "VIBE-CAM, camera-motion-on", (4.66, 81.70, 132.63)),
        ("9", "3 / 1024", (0.86, 5.91, 7.96)),
        ("10", "Non-sequential", (3.90, 45.48, 126.83)),
    ],
)
def test_figures_are_the_papers(table, row, figures):
    recipe = load_table(table)
    found = {one.name.lower(): one.paper for one in recipe.rows}[row.lower()]
    assert tuple(found.get(metric) for metric in ("ome_deg", "tme_mm", "vme_mm")) == figures


def test_rows_at_the_papers_scale_have_its_settings():
    """Table 4's first row is Table 3's last; flip is its one difference to the second."""
    table3 = load_table("3")
    table4 = load_table("4")
    without, with_flip = (train_config(table4, row, "paper", 0, ()) for row in table4.rows)
    assert train_config(table3, table3.rows[-1], "paper", 0, ()) == without
    assert (without.model.layers, without.model.hidden) == (4, 2048)
    assert (without.learning_rate, without.batch_size) == (5e-5, 32)
    assert without.windows.reverse_probability == 0.0
    assert (without.loss.reduction, without.windows.all_phases) == ("sum", False)
    assert with_flip.windows.reverse_probability == 0.5
    vertex_alone = train_config(table3, table3.rows[0], "paper", 0, ()).loss
    assert (vertex_alone.vertex, vertex_alone.orientation) == (1.0, 0.0)
    assert (vertex_alone.translation, vertex_alone.smoothness) == (0.0, 0.0)


def test_each_recipe_of_the_paper_sums_its_loss_or_says_that_it_does_not():
    recipe = recipes.load_recipe(recipes.find_recipe("gmr"), GmrRecipe)
    assert (recipe.train.loss.reduction, recipe.train.windows.all_phases) == ("sum", False)
    for name in ("1", "2", "3", "4", "5", "6", "9", "10"):
        table = load_table(name)
        for scale, reduction in (("paper", "sum"), ("small", "mean")):
            row = table.rows[-1]
            for config in (
                train_config(table, row, scale, 0, ()),
                joint_config(table, row, scale, 0) if name == "10" else None,
            ):
                assert config is None or config.loss.reduction == reduction
            assert ("means in the loss" in table.scales[scale].note) == (reduction == "mean")


def test_table_9_has_both_latent_sizes():
    table = load_table("9")
    plan = plan_table(table, "paper", Given((Path("a.yaml"),), scored=Path("b.yaml")))
    sizes = [
        (config.model.layers, config.model.hidden, config.model.n_features)
        for config in plan.trainings.values()
    ]
    nine = [(layers, hidden) for layers in (2, 3, 4) for hidden in (512, 1024, 2048)]
    assert sizes[:9] == [(layers, hidden, hidden) for layers, hidden in nine]
    assert sizes[9:] == [(layers, hidden, 2048) for layers, hidden in nine if hidden < 2048]


def test_a_row_with_an_unknown_setting_is_refused_with_file_and_row(tmp_path):
    path = tiny(tmp_path, "orientation_loss:", "orientation_los:")
    with pytest.raises(BadRecipe) as caught:
        load_table(path)
    assert path in str(caught.value)
    assert "row 'Angular' at scale small" in str(caught.value)
    assert "loss.orientation_los: Extra inputs are not permitted" in str(caught.value)


@pytest.mark.parametrize(
    "names", [("w_smooth 1e-2", "w_smooth 1e+2"), ("lr=1e-4", "LR 1e-4"), ("걷기", "뛰기")]
)
def test_rows_that_would_share_a_folder_are_refused(names, tmp_path):
    """One of the two was never trained, and had the other's figures."""
    rows = TINY.partition("rows:")[2]
    named = rows.replace("Chordal", f"'{names[0]}'").replace("Angular", f"'{names[1]}'")
    said = f"rows: {names[0]!r}, {names[1]!r}: names must differ in letters a-z or digits"
    with pytest.raises(BadRecipe, match=re.escape(said)):
        load_table(tiny(tmp_path, rows, named))


def test_a_seed_that_a_recipe_names_twice_is_refused(tmp_path):
    """Its one training counted as two that agreed, with a spread of 0."""
    with pytest.raises(BadRecipe, match=r"tiny\.yaml.*\n?.*small.*seeds: a seed counts twice"):
        load_table(tiny(tmp_path, "seeds: [3]", "seeds: [3, 3]"))


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ("- {name: B, network: Chordal, train: {steps: 2}}", "B: has `train`, and no training"),
        ("- {name: B, scores: Chordal, train: {steps: 2}}", "B: has `train`, and no training"),
        ("- {name: B, method: vibe_cam, train: {steps: 2}}", "B: has `train`, and no training"),
        (
            "- {name: B, network: Chordal, at: {small: {train: {steps: 2}}}}",
            "B: has `train`, and no training of its own",
        ),
        (
            "- {name: B, network: Chordal}\n- {name: C, network: B}",
            "C: row 'B' trains no network of method gmr",
        ),
        (
            "- {name: B, method: joint, network: Chordal}",
            "B: row 'Chordal' trains no network of method joint",
        ),
        (
            "- {name: B, scores: Chordal}\n- {name: C, scores: B}",
            "C: row 'B' has no scores of its own",
        ),
        ("- {name: B, train: {data: {held_out_subjects: [2]}}}", "B: `train` has `data`, which"),
        ("- {name: B, at: {small: {train: {data: {balance: 1}}}}}", "B: `train` has `data`, which"),
    ],
)
def test_a_row_whose_words_would_have_no_effect_is_refused(rows, said, tmp_path):
    with pytest.raises(BadRecipe, match=re.escape(f"rows: {said}")):
        load_table(tiny(tmp_path, more=rows))


def test_rows_without_their_files_are_not_made_and_say_what_they_need(tmp_path):
    table5 = load_table("5")
    with pytest.raises(MissingInput) as caught:
        make_table(table5, "small", Given(()), tmp_path, run=Run(workers=1))
    message = str(caught.value)
    assert "VIBE-CAM: clips to score (--scored); VIBE's poses" in message
    assert "Ours(GT input): motions to train on (--manifest)" in message
    assert "(--manifest) or a network (--network)" in message
    # A network stands for no table that compares trainings, and was asked for all the same.
    compares = plan_table(load_table("2"), "small", Given(()))
    assert {*map(tuple, compares.lacking.values())} == {("motions to train on (--manifest)",)}
    scored = Path("set.yaml")
    plan = plan_table(table5, "small", Given((Path("a.yaml"),), scored=scored))
    assert plan.lacking.keys() == {"VIBE-CAM", "Ours"}
    assert list(plan.trainings) == [f"ours_gt_input/seed_{n}" for n in range(3)]


def test_a_row_counts_the_clips_whose_camera_stands_still_or_moves():
    """Table 6: one score of a set and its twins, two rows."""
    table6 = load_table("6")
    plan = plan_table(table6, "small", Given((Path("a.yaml"),), scored=Path("set.yaml")), (0,))
    off, on = (f"Ours(GT input), camera-motion-{word}" for word in ("off", "on"))
    assert plan.scorings[off] == plan.scorings[on]
    assert len(plan.trainings) == 1 and len(plan.lacking) == 4

    clips = [
        clip_score(name, metrics(0.0, tme_mm, 0.0), camera_motion=name, n_motions=n_motions)
        for name, n_motions, tme_mm in (("static", 5, 7.0), ("linear", 1, 2.0), ("small", 3, 6.0))
    ]
    scores = score_record(clips)
    assert clip_figure("tme_mm", scores, "predicted", table6.row(off)) == 7.0
    assert clip_figure("tme_mm", scores, "predicted", table6.row(on)) == 5.0
    with pytest.raises(BadManifest, match="none has a camera that stands still"):
        clip_figure("tme_mm", score_record(clips[1:]), "predicted", table6.row(off))
    # Without a camera none moves: such clips were counted as if it did.
    bare = clip_score("none", metrics(0.0, 90.0, 0.0), camera_motion="none", n_motions=9)
    scores = score_record([*clips, bare])
    assert clip_figure("tme_mm", scores, "predicted", table6.row(on)) == 5.0


def test_a_row_says_of_its_own_clips_what_is_left_out(write_walks):
    """A row of moving clips was said to be of other frames where a still one was not seen; a row
    whose clips were all not seen lost the whole table."""
    table6, folder = load_table("6"), Path("poses")
    scored = write_walks("scored", ["01_01"], 1)
    given = Given((), scored, folder, folder, network=network_dir("bundled"))
    plan = plan_table(table6, "small", given)
    clips = {
        name: clip_score(name, metrics(1.0, 2.0, 3.0), camera_motion=name)
        for name in ("static", "linear")
    }
    lacking = {"static": "no prediction static.npz"}
    whole = score_record(list(clips.values()))
    part = score_record([clips["linear"]]).model_copy(update={"skipped": lacking})
    scores = {name: [part if name.startswith("VIBE") else whole] for name in plan.scorings}
    record = _record(plan, scores, {name: name for name in clips})
    rows = {row.name: row for row in record.rows}
    off, on = (rows[f"VIBE-CAM, camera-motion-{word}"] for word in ("off", "on"))
    assert (off.ours, off.left_out) == (None, lacking)
    assert on.ours is not None and on.left_out == {}
    assert record.lacking == {off.name: ("a prediction of a clip whose camera stands still",)}
    # Nothing was trained, so nothing was shrunk for it.
    assert record.note == ""


def test_a_network_stands_for_the_trainings_of_a_table_that_compares_none():
    given = Given((), Path("set.yaml"), Path("poses"), Path("keypoints"), network=Path("run"))
    plan = plan_table(load_table("6"), "small", given)
    assert not plan.trainings and not plan.lacking
    assert [[one.training for one in ones] for ones in plan.scorings.values()] == [[None]] * 8
    joint = replace(given, features=Path("features"), videos=(Path("videos.yaml"),))
    plan = plan_table(load_table("10"), "small", joint)
    assert list(plan.trainings) == [f"non_sequential/seed_{n}" for n in range(3)]
    with pytest.raises(BadRecipe, match=r"table 4 compares trainings \(.*Leave out --network"):
        plan_table(load_table("4"), "small", given)


def test_people_are_held_out_of_the_manifests_that_are_given():
    """The table said that nobody was trained on them, whoever the network had been trained on."""
    given = Given((), Path("set.yaml"), network=Path("run"), held_out=(2,))
    with pytest.raises(BadRecipe, match="--held-out-subjects: they are people of --manifest"):
        plan_table(load_table("6"), "small", given)


def test_rows_have_the_name_of_who_estimated():
    table5 = load_table("5")
    plan = plan_table(table5, "small", Given((), Path("set.yaml"), estimator="Fit"))
    named = ["Fit-CAM", "Ours(Fit)", "Ours(GT input)", table5.rows[-1].name]
    assert [plan.shown_name(row) for row in table5.rows] == named
    paper = plan_table(table5, "small", Given((), Path("set.yaml")))
    assert [paper.shown_name(row) for row in table5.rows] == [row.name for row in table5.rows]


def test_orderings_in_sentences():
    def row(name: str, paper: float, mean: float, **lacks: Any) -> TableRow:
        ours = OverSeeds(mean=mean, spread=0.1, by_seed=(mean - 0.1, mean + 0.1))
        return TableRow(
            name=name,
            name_in_paper=name,
            method="gmr",
            paper=PaperMetrics(ome_deg=paper, tme_mm=None, vme_mm=None),
            seeds=(0, 1),
            settings=None,
            ours=PaperMetrics(ome_deg=ours, tme_mm=ours, vme_mm=ours),
            **{"clips": "all", "dropped_frames": 0, "left_out": {}} | lacks,
        )

    lines = orderings([row("a", 1.0, 2.0), row("b", 1.1, 1.95), row("c", 1.2, 3.0)])
    assert lines == [
        "OME: 2 of the paper's 3 orderings hold here.",
        "OME, holds: a below c; b below c.",
        "OME, does not hold: a below b (within the seeds' spread).",
        "OME: the paper's best row is a, here it is b.",
    ]
    other = "OME, holds: a below b (on other frames)."
    for lacks in ({"dropped_frames": 5}, {"left_out": {"walk": "no prediction walk.npz"}}):
        assert other in orderings([row("a", 1.0, 2.0), row("b", 1.1, 3.0, **lacks)])
    one = row("a", 1.0, 2.0, left_out={"walk": "no file a/walk.npz"})
    same = row("b", 1.1, 3.0, left_out={"walk": "no file b/walk.npz"})
    still = row("b", 1.1, 3.0, clips="still", dropped_frames=5)
    for rows in ([one, same], [one, still]):
        assert "OME, holds: a below b." in orderings(rows)


def test_each_key_of_a_table_is_needed(tmp_path):
    zero = PaperMetrics(ome_deg=None, tme_mm=1.0, vme_mm=1.0)
    ours = OverSeeds(mean=1.0, spread=None, by_seed=(1.0,))
    row = TableRow(
        name="a",
        name_in_paper=None,
        method="gmr",
        clips="all",
        paper=zero,
        seeds=(0,),
        settings={"steps": 3},
        ours=PaperMetrics(ome_deg=ours, tme_mm=ours, vme_mm=ours),
        dropped_frames=2,
        left_out={"walk": "no prediction walk.npz"},
    )
    data = TableData(
        paper="3DPW",
        training=(TrainedOn(name="walks/manifest.yaml", clips=2),),
        left_out={"of held-out subject 02": 1},
        network="bundled",
        estimator="VIBE",
        scored="walks (1 clips, 9 motions)",
        held_out_subjects=("02",),
    )
    record = TableRecord(
        table=2,
        title="Two losses",
        scale="small",
        note="",
        data=data,
        rows=(row,),
        lacking={"b": ("clips to score (--scored)",)},
        statements=(),
    )
    free = ("data.left_out", "lacking", "rows.0.settings", "rows.0.left_out")
    assert_each_key_is_needed(record, tmp_path / "table2.json", free)


@pytest.fixture
def write_walks(small_body, tmp_path) -> Callable[..., Path]:
    """A manifest of generated walks, named like CMU's trials."""

    def write(name: str, trials: list[str], seed: int) -> Path:
        clips = walking_clips(small_body, trials, seed, duration_s=3.0)
        return write_clips(tmp_path / name, small_body, clips, sources="CMU")

    return write


@pytest.mark.slow
def test_a_table_from_the_command_line_and_again(write_walks, body_path, tmp_path, works):
    """Subject 02 is held out; the second call finds everything made."""
    recipe = tiny(tmp_path)
    motions, out = write_walks("walks", ["01_01", "01_02", "02_01"], 1), tmp_path / "out"

    def tables(*more: str) -> str:
        given = ("--manifest", motions, "--held-out-subjects", "2", "--body", body_path)
        return str(works("tables", recipe, *given, "--out", out, "--workers", "1", *more).stdout)

    planned = tables("--dry-run")
    assert "angular/seed_3" in planned and "2 of 2 trainings to make" in planned
    assert not out.exists()
    said = tables()
    assert "TME: " in said and "of the paper's 1 orderings hold here" in said
    record = read_json(out / "table2.json")
    chordal, angular, zero = record["rows"]
    assert chordal["settings"]["loss"]["orientation_loss"] == "chordal"
    assert angular["settings"]["loss"]["orientation_loss"] == "angular"
    assert angular["seeds"] == [3] and angular["paper"]["ome_deg"] == 1.5
    scores = read_json(out / "scores" / "angular" / "seed_3" / "scores.json")
    pooled = scores["overall"]["pooled_over_motions"]
    assert angular["ours"]["tme_mm"]["mean"] == pooled["predicted"]["tme_mm"]
    assert zero["ours"]["tme_mm"]["mean"] == pooled["zero"]["tme_mm"]
    assert chordal["ours"]["ome_deg"]["mean"] != angular["ours"]["ome_deg"]["mean"]
    assert [clip["id"] for clip in scores["clips"]] == ["02_01"]
    assert record["data"]["training"] == [{"name": "walks/manifest.yaml", "clips": 2}]
    assert load_gmr(out / "runs" / "angular" / "seed_3").step == 4
    with (out / "table2.csv").open(newline="") as stream:
        names = [row["row"] for row in csv.DictReader(stream)]
        assert names == ["Chordal", "Angular", "no motion at all"]
    text = (out / "table2.md").read_text()
    assert "means over motions and vertices, where eqs. 9-14 are sums." in text
    assert "trained on in all their phases" in text
    assert "Paper: something larger." in text and "Scale small. Tiny." in text
    made = _written(out)
    assert tables() == said
    assert _written(out) == made


def test_workers_get_absolute_paths(write_walks, tmp_path, monkeypatch):
    """A worker in another folder found no manifest, or trained and scored into that folder."""
    walks = write_walks("walks", ["01_01", "01_02"], 1)
    monkeypatch.chdir(walks.parent)
    asked: list[Job] = []

    def stop(_: str, jobs: Sequence[Job], *__: object) -> None:
        asked.extend(jobs)
        raise StageFailed("stopped")

    monkeypatch.setattr("gmrdata.paper.make.run_jobs", stop)
    manifest = Path(walks.name)
    given = Given((manifest,), manifest, videos=(manifest,), held_out=(2,), body=Path("body.npz"))
    with pytest.raises(StageFailed, match="stopped"):
        make_table(load_table(tiny(tmp_path)), "small", given, Path("out"))
    body = walks.with_name("body.npz")
    own = replace(given, manifests=(walks,), scored=walks, videos=(walks,), body=body)
    found = [(job.arguments["given"], job.arguments["out_dir"]) for job in asked]
    assert found == 2 * [(own, walks.with_name("out"))]


def test_a_dry_run_says_of_each_training_what_its_worker_would(write_walks, body_path, tmp_path):
    """Trainings of other settings were said to be made, and the table then failed."""
    given = Given((write_walks("walks", ["01_01", "02_01"], 1),), held_out=(2,), body=body_path)
    planned, out = plan_table(load_table(tiny(tmp_path)), "small", given), tmp_path / "out"
    id, config = next(iter(planned.trainings.items()))
    train_one(id, config, given, out, Run())

    def states(plan: Plan, run: Run = DEFAULT_RUN) -> list[str]:
        return [row[3] for row in planned_runs(plan, out, run)[0]]

    assert states(planned) == ["made", "to make"]
    other = plan_table(load_table(tiny(tmp_path, "steps: 4", "steps: 5")), "small", given)
    run_dir = out / "runs" / id
    stale = f"{run_dir}: made with other values of config.steps. Pass --redo to make it again, or"
    assert states(other) == [f"{stale} another --out", "to make"]
    assert states(other, Run(redo=True)) == ["to make", "to make"]
    assert "1 of 2 trainings to make" in planned_runs(planned, out)[1][0]
    # Nobody is there to score, or to train on: it listed the trainings, and the table ended.
    refused = {(9,): "no clip is of 9", (1, 2): "no usable clips", (): "no row can be made"}
    for held_out, said in refused.items():
        wrong = plan_table(load_table(tiny(tmp_path)), "small", replace(given, held_out=held_out))
        with pytest.raises((BadRecipe, BadManifest, MissingInput), match=said):
            planned_runs(wrong, out)


def test_a_table_says_how_many_clips_a_manifest_gave_where_people_are_balanced(
    write_walks, tmp_path
):
    """Its parts were people, more than manifests: the table was lost after all its trainings."""
    recipe = tiny(tmp_path, "    train:\n", "    train:\n      data: {balance: 0.5}\n")
    manifests = (
        write_walks("walks", ["01_01", "01_02", "02_01", "03_01"], 1),
        write_walks("more", ["04_01", "05_01"], 2),
    )
    data = data_of(load_table(recipe), Given(manifests, held_out=(2,)))
    assert [(one.name, one.clips) for one in data.training] == [
        ("walks/manifest.yaml", 3),
        ("more/manifest.yaml", 2),
    ]


def test_the_held_out_set_holds_the_same_motions(write_walks, tmp_path):
    motions = write_walks("walks", ["01_01", "02_01", "02_02"], 1)
    path = held_out_set([motions], DataConfig(held_out_subjects=(2,)), tmp_path / "held_out")
    copies = {clip.id: clip for clip in load_clips(path)}
    originals = {clip.id: clip for clip in load_clips(motions)}
    assert copies.keys() == {"02_01", "02_02"}
    for id, clip in copies.items():
        assert (clip.motion.pelvis_m == originals[id].motion.pelvis_m).all()
        assert (clip.motion.local_rotmats == originals[id].motion.local_rotmats).all()
    with pytest.raises(BadRecipe, match="nothing to score: give --scored"):
        held_out_set([motions], DataConfig(), tmp_path / "other")
    # Both were tracebacks: a link out of the set, and a file that is no clip.
    arrays = motions.parent / "02_01.npz"
    arrays.rename(tmp_path / "02_01.npz")
    arrays.symlink_to(tmp_path / "02_01.npz")
    config = DataConfig(held_out_subjects=(2,))
    with pytest.raises(BadManifest, match=r"clip 02_01: arrays\.path: path .* a link out of"):
        held_out_set([motions], config, tmp_path / "linked")
    arrays.unlink()
    write_npz(arrays, {"other": np.zeros(3)})
    with pytest.raises(BadMotionFile, match=r"02_01\.npz: has no `format`"):
        held_out_set([motions], config, tmp_path / "none")


@pytest.mark.slow
def test_a_network_is_scored_on_a_set_of_held_out_people_alone(write_walks, body_path, tmp_path):
    """It was refused, as if somebody of the set had to be trained on."""
    motions = write_walks("walks", ["02_01", "02_02"], 1)
    rows = f"rows:\n- {{name: Ours, paper: {{tme_mm: 6.0}}}}{TINY.partition('rows:')[0]}"
    (tmp_path / "one.yaml").write_text(rows, encoding="utf-8")
    recipe = load_table(str(tmp_path / "one.yaml"))
    given = Given((motions,), held_out=(2,), body=body_path)
    with pytest.raises(BadManifest, match="2 of 2 clips"):
        make_table(recipe, "small", given, tmp_path / "trained")
    assert not (tmp_path / "trained" / "held_out").exists()
    scored = replace(given, network=network_dir("bundled"))
    path = make_table(recipe, "small", scored, tmp_path / "out", run=Run(workers=1))
    table = TableRecord.read(path)
    assert table.data.scored == "the held-out subjects (2 clips, 58 motions)"
    assert table.data.network == "bundled" and table.rows[0].ours is not None


def test_scored_clips_that_are_trained_on_are_counted(write_walks, tmp_path, capsys):
    motions = write_walks("walks", ["01_01", "02_01"], 1)
    given = Given((motions,), scored=write_walks("scored", ["02_01", "03_01"], 2))
    data = data_of(load_table(tiny(tmp_path)), given)
    assert data.scored.endswith("motions; 1 of these clips are trained on)")
    assert "scored/manifest.yaml; 1 of these clips are trained on" in capsys.readouterr().err


def test_a_table_says_nothing_of_whom_a_given_network_was_trained_on(write_walks):
    motions = write_walks("walks", ["01_01", "02_01"], 1)
    given = Given((motions,), motions, network=network_dir("bundled"), held_out=(2,))
    data = data_of(load_table("5"), given)
    assert (data.training, data.left_out, data.held_out_subjects) == ((), {}, ())
    assert data.scored.endswith("motions)")


def test_people_are_held_out_of_the_videos_too(write_walks, body_path, tmp_path):
    """The non-sequential model was trained on them, and the table said that it was not."""
    motions, videos = (write_walks(name, ["01_01", "02_01"], 1) for name in ("walks", "videos"))
    features = np.zeros((60, 4), np.float32)
    write_npz(tmp_path / "features" / "01_01.npz", {"features": features})
    given = Given(
        (motions,), motions, poses=tmp_path, features=tmp_path / "features", videos=(videos,),
        held_out=(2,), body=body_path,
    )  # fmt: skip
    config = JointConfig(
        model=NetworkConfig(layers=1, hidden=4), loss=LossConfig(n_vertices=8), frames=16,
        batch_size=2, steps=1,
    )  # fmt: skip
    train_one("joint/seed_0", config, given, tmp_path / "out", Run())
    inputs = StageRecord.of(tmp_path / "out" / "runs" / "joint" / "seed_0").inputs
    assert inputs.keys() == {"manifest_0", "features_01_01", "body"}
    data = data_of(load_table("10"), given)
    assert [one.name for one in data.training] == ["walks/manifest.yaml", "videos/manifest.yaml"]
    assert [one.clips for one in data.training] == [1, 1]
    assert data.left_out == {"of held-out subject 2": 2}
    assert data.held_out_subjects == (2,)
    assert "1 of these clips are trained on" in data.scored


def test_videos_whose_clips_have_one_id_are_refused(write_walks):
    """Both had the features of one of them."""
    videos = [write_walks("here", ["01_01", "01_02"], 1), write_walks("there", ["01_02"], 2)]
    with pytest.raises(BadManifest, match="clips of one id in two manifests: 01_02"):
        split_videos(videos)


def _written(out: Path) -> dict[str, int]:
    """When each run and score was written."""
    return {
        path.relative_to(out).as_posix(): path.stat().st_mtime_ns
        for path in out.rglob("stage.json")
    }


@pytest.fixture
def table5(filmed, small_body, write_set, body_path, tmp_path) -> Callable[[], TableRecord]:
    """Exact poses and keypoints of two clips, and a function that makes Table 5 of them in out/."""
    clips = [replace(clip, motion=replace(clip.motion, shape=np.zeros(10))) for clip in filmed[:2]]
    manifest = write_set(tmp_path / "set", clips)
    for clip in clips:
        seen = motion_in_camera(clip.motion, camera_of(clip).world_from_cam)
        rest_pelvis_m = small_body.rest_pelvis_m(seen.shape)
        posed = replace(clip, motion=seen, camera=None)
        save_clip(tmp_path / "poses" / f"{clip.id}.npz", posed, rest_pelvis_m)
        write_frames(tmp_path / "keypoints" / clip.id, clip, small_body)

    def make() -> TableRecord:
        command = ["tables", "5", "--scored", str(manifest), "--network", "bundled"]
        command += ["--poses", str(tmp_path / "poses"), "--keypoints", str(tmp_path / "keypoints")]
        command += ["--estimator", "Nobody", "--body", str(body_path), "--workers", "1"]
        main([*command, "--out", str(tmp_path / "out")])
        return TableRecord.read(tmp_path / "out" / "table5.json")

    return make


def test_every_row_is_made_with_the_network_of_the_package(table5, tmp_path):
    """With exact poses GMR's two rows agree, and VIBE-CAM's are what the camera sees."""
    record = table5()
    rows = {row.name: row.ours for row in record.rows}
    assert list(rows) == [
        "Nobody-CAM",
        "Ours(Nobody)",
        "Ours(GT input)",
        "true camera-frame poses as world poses",
        "no motion at all",
    ]
    assert (record.data.network, record.data.estimator) == ("bundled", "Nobody")
    text = (tmp_path / "out" / "table5.md").read_text()
    assert "GMR: network bundled, as it is." in text
    assert "Nobody: who estimates where the paper has VIBE." in text
    figures = {name: ours.model_dump() for name, ours in rows.items() if ours}
    for metric in ("ome_deg", "tme_mm", "vme_mm"):
        means = {name: figures[name][metric]["mean"] for name in figures}
        np.testing.assert_allclose(means["Ours(Nobody)"], means["Ours(GT input)"], rtol=1e-5)
        np.testing.assert_allclose(
            means["Nobody-CAM"], means["true camera-frame poses as world poses"], rtol=1e-3
        )
    scores = read_json(tmp_path / "out" / "scores" / "ours" / "scores.json")
    assert scores["overall"]["n_clips"] == 2


def test_a_frame_and_a_clip_that_are_not_seen_are_left_out_and_said(table5, tmp_path):
    """They cost the whole table, whose rows may be of other frames than each other's."""
    nobody = [person(np.zeros((24, 2)), 0.0)]
    write_frame(tmp_path / "keypoints" / "walk_0", 120, nobody)
    (tmp_path / "poses" / "walk_1.npz").unlink()
    rows = {row.name: (row.dropped_frames, row.left_out) for row in table5().rows}
    lacking = {"walk_1": "no prediction walk_1.npz"}
    assert rows == {
        "Nobody-CAM": (1, lacking),
        "Ours(Nobody)": (0, lacking),
        "Ours(GT input)": (0, {}),
        "true camera-frame poses as world poses": (0, {}),
        "no motion at all": (0, {}),
    }
    text = (tmp_path / "out" / "table5.md").read_text()
    said = "valid frames without a prediction: 1; clips: walk_1"
    assert f"- Left out of Nobody-CAM: {said}.\n" in text
    assert "- Left out of Ours(Nobody): clips: walk_1.\n" in text and text.count("Left out") == 2
    assert "scored on set/manifest.yaml (2 clips, 38 motions)." in text
    record = read_json(tmp_path / "out" / "predictions" / "ours" / "predictions.json")
    assert record["left_out"] == {"walk_1": "no poses/walk_1.npz"}
