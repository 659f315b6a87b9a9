"""Scores of a manifest: their numbers, groups and refusals."""

import csv
import json
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from gmrdata.gmr.checkpoint import best_of
from gmrdata.gmr.config import DataConfig, LossConfig, ModelConfig, TrainConfig, WindowConfig
from gmrdata.gmr.model import Gmr
from gmrdata.gmr.predict import TrainedGmr, load_gmr
from gmrdata.gmr.runs import UsableClip, runs_at, usable_files
from gmrdata.gmr.train import train
from gmrdata.manifest.current import Quality
from gmrdata.read.body_file import save_body
from gmrdata.score import METHODS, METRICS, Metric
from gmrdata.score.baselines import predict_zero
from gmrdata.score.clip_errors import ClipErrors, clip_errors
from gmrdata.score.predictions import Pairing, PredictedClip, network_clip
from gmrdata.score.predictors import ScoreConfig
from gmrdata.score.protocols import PROTOCOLS
from gmrdata.score.records import Protocol, Scores
from gmrdata.score.score import ScoredBodies, motion_types, plan_scores, score, score_clips
from gmrdata.score.summary import summarise
from gmrdata.stage.progress import answers
from gmrdata.stage.run import Run
from gmrdata.values import motion_metrics as vertices
from gmrdata.values.body import BodyModel, with_vertices
from gmrdata.values.camera import CameraPath
from gmrdata.values.clip import Clip
from gmrdata.values.errors import (
    BadBodyFile,
    BadCheckpoint,
    BadManifest,
    BadMotionFile,
    StaleOutput,
)
from gmrdata.values.files import write_json
from gmrdata.values.motion import deltas
from gmrdata.values.skinning import motion_vertices_m
from gmrdata.values.transforms import rigid
from tests.clip_manifests import write_clips as write_manifest_of
from tests.clips_in_memory import counted_clips
from tests.fixtures.inference import keep_gmr, stepped_gmr
from tests.motions import bare_clip, walking_clips, with_camera

FLOOR_GROUP = {
    "sequences": 1,
    "accepted": 1,
    "class_right": 1,
    "n_motions": 9,
    "camera_rotation_deg": None,
    "camera_path_mm": None,
    "abs_scale_error_percent": None,
    "scale_stated": 0,
    "scale_within_2sigma": 0,
    "kept_share": 1.0,
    "seconds_per_frame": 1.0,
}
CAMERA_MOTIONS = ("circular", "linear", "circular")


@pytest.fixture(scope="module")
def clips(small_body) -> list[Clip]:
    made = walking_clips(small_body, [f"clip_{i}" for i in range(3)], fps_hz=30.0, duration_s=2.0)
    for i, clip in enumerate(made):
        clip.valid[30 : 30 + 5 * i] = False
    return made


def write_clips(
    folder: Path,
    body: BodyModel,
    clips: list[Clip],
    qualities: dict[str, Quality] | None = None,
    kind: str = "motions",
) -> Path:
    motions = CAMERA_MOTIONS[: len(clips)]
    return write_manifest_of(folder, body, clips, qualities, camera_motions=motions, kind=kind)


@pytest.fixture
def run_dir(tmp_path) -> Path:
    keep_gmr(tmp_path / "run", 1, *stepped_gmr(ModelConfig(layers=1, hidden=6)))
    return tmp_path / "run"


@pytest.fixture
def score_run(run_dir, body_path, tmp_path) -> Callable[..., Path]:
    """Score the run on a manifest into a folder of that name; gives the scores.json."""

    def scored(manifest: Path, name: str = "scores", *config: ScoreConfig, **more: Any) -> Path:
        made = score(run_dir, manifest, tmp_path / name, *config, body_path=body_path, **more)
        return made.scores[0]

    return scored


class Oracle:
    """Stands for a network that knows the answer, but for 1 deg of yaw and 10 mm to the front."""

    fps_hz = 10.0

    def __init__(self, clips: list[Clip]) -> None:
        self.by_pose = {}
        for clip in clips:
            for motion in runs_at(clip, 10.0, all_phases=True):
                self.by_pose[motion.local_rotmats.tobytes()] = deltas(
                    motion.root_rotmats, motion.pelvis_m
                )

    def predict(self, _: object, local_rotmats: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        delta_rotmats, delta_m = self.by_pose[np.ascontiguousarray(local_rotmats).tobytes()]
        angle_rad = np.deg2rad(1.0)
        c, s = np.cos(angle_rad), np.sin(angle_rad)
        yaw = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
        return delta_rotmats @ yaw, delta_m + np.array([0, 0, 0.01])


def test_known_errors_get_known_scores(clips, small_body, monkeypatch):
    """And zero motion's score is the motion's own size, gaps left out."""
    oracle = Oracle(clips)
    monkeypatch.setattr("gmrdata.gmr.predict.predict_deltas", oracle.predict)
    scored, skipped = score_clips(
        partial(network_clip, oracle, how=Pairing(10.0)),  # type: ignore[arg-type]
        ScoredBodies((small_body,), (small_body,)),
        clips,
        ["linear"] * 3,
    )
    assert skipped == {}
    # Frames 0, 3, ..., 57; then 0, ..., 27 and 35, ..., 59; then 0, ..., 27 and 40, ..., 58.
    assert [one.n_motions for one in scored] == [19, 9 + 8, 9 + 6]
    for one, clip in zip(scored, clips, strict=True):
        np.testing.assert_allclose(one.errors["predicted"]["ome_deg"], 1.0, atol=1e-9)
        np.testing.assert_allclose(one.errors["predicted"]["tme_mm"], 10.0, atol=1e-9)
        rows = np.arange(0, 30, 3)
        _, delta_m = deltas(clip.motion.root_rotmats[rows], clip.motion.pelvis_m[rows])
        steps_mm = 1000 * np.linalg.norm(delta_m, axis=1)
        np.testing.assert_allclose(one.errors["zero"]["tme_mm"][:9], steps_mm)


def scored_by(
    gmr: TrainedGmr, body: BodyModel, clip: Clip, protocol: Protocol | None = None, **how: Any
) -> ClipErrors:
    predict = partial(network_clip, gmr, how=Pairing(10.0, **how))
    bodies = ScoredBodies((body,), (body,))
    ((one,), _) = score_clips(predict, bodies, [clip], ["none"], protocol)
    return one


@pytest.mark.parametrize(("all_phases", "n_frames"), [(False, 7 + 4), (True, 3 * 7 + 4 + 4 + 3)])
def test_a_clip_with_gaps_counts_once(all_phases, n_frames, clips, small_body, run_dir):
    """A network begins anew after each gap and in each phase; EMDB's jitter is one per sequence."""
    emdb, gmr = PROTOCOLS["emdb"], load_gmr(run_dir)
    by_frame = emdb.model_copy(update={"once_per_clip": ()})
    once, each = (
        scored_by(gmr, small_body, clips[2], one, all_phases=all_phases).protocol
        for one in (emdb, by_frame)
    )
    for method in METHODS:
        samples = each[method]["jitter_10m_per_s3"]
        assert len(samples) == n_frames
        np.testing.assert_array_equal(once[method]["jitter_10m_per_s3"], [samples.mean()])


def test_vme_is_the_distance_between_placed_meshes(clips, small_body, run_dir, monkeypatch):
    """Against meshes of the body model itself: M([dA, L], beta, dT), frame by frame."""
    from gmrdata.gmr.predict import predict_deltas

    monkeypatch.setattr(vertices, "CHUNK_BYTES", len(small_body.template_m) * 24 * 8 * 3)
    gmr = load_gmr(run_dir)
    one = scored_by(gmr, small_body, clips[0])
    (run,) = runs_at(clips[0], 10.0, all_phases=False)
    true_rotmats, true_m = deltas(run.root_rotmats, run.pelvis_m)
    rotmats, metres = predict_deltas(gmr, run.local_rotmats)
    rows = slice(0, 19)
    part = replace(run, local_rotmats=run.local_rotmats[rows], root_rotmats=rotmats)
    meshes_m = motion_vertices_m(small_body, replace(part, pelvis_m=metres))
    true_meshes_m = motion_vertices_m(
        small_body, replace(part, root_rotmats=true_rotmats, pelvis_m=true_m)
    )
    expected_mm = 1000 * np.linalg.norm(meshes_m - true_meshes_m, axis=-1).mean(-1)
    np.testing.assert_allclose(one.errors["predicted"]["vme_mm"], expected_mm, rtol=1e-4)


def test_pooled_and_mean_of_clips_differ_as_they_should():
    def errors(
        clip_id: str, camera_motion: str, values: list[float], motion_type: str | None = None
    ) -> ClipErrors:
        arrays: dict[Metric, np.ndarray] = {metric: np.array(values) for metric in METRICS}
        over_time = {method: np.array([0.0, *values]) for method in METHODS}
        both = dict.fromkeys(METHODS, arrays)
        return ClipErrors(clip_id, camera_motion, both, motion_type, over_time)

    found = summarise(
        [
            errors("a", "linear", [1.0], "walk"),
            errors("b", "circular", [4.0, 4.0, 4.0]),
            errors("c", "linear", [7.0, 9.0], "walk"),
        ],
        10.0,
        500,
        np.random.default_rng(0),
    ).model_dump(mode="json")
    overall = found["overall"]
    assert (overall["n_clips"], overall["n_motions"]) == (3, 6)
    assert overall["pooled_over_motions"]["predicted"]["tme_mm"] == pytest.approx(29 / 6)
    assert overall["mean_of_clips"]["predicted"]["tme_mm"] == pytest.approx((1 + 4 + 8) / 3)
    assert found["camera_motion"]["linear"]["pooled_over_motions"]["zero"][
        "ome_deg"
    ] == pytest.approx(17 / 3)
    assert list(found["camera_motion"]) == ["circular", "linear"]
    assert [clip["predicted"]["vme_mm"] for clip in found["clips"]] == [1.0, 4.0, 8.0]
    assert list(found["motion_type"]) == ["walk"]
    walk = found["motion_type"]["walk"]
    assert walk["mean_of_clips"] == found["camera_motion"]["linear"]["mean_of_clips"]
    # Two clips of means 1 and 8: every draw is one of them, or both.
    assert walk["mean_of_clips_interval95"]["predicted"]["tme_mm"] == [1.0, 8.0]
    assert found["camera_motion"]["circular"]["pooled_interval95"]["zero"]["vme_mm"] is None
    # Two clips of three last 0.2 s, and the curve is of them all along.
    over_time = found["over_time"]
    assert (over_time["times_s"], over_time["clips"]) == ([0.0, 0.1, 0.2], ["b", "c"])
    np.testing.assert_allclose(over_time["predicted"]["vertex_mm"], [0, 5.5, 6.5])
    assert over_time["predicted"]["interval95_mm"] == [[0, 4, 4], [0, 7, 9]]


def test_the_order_of_clips_changes_no_figure():
    """Of a manifest turned over, which `manifest diff` calls the same, intervals were others."""
    rng = np.random.default_rng(3)
    made = []
    for clip_id, size in (("a", 3), ("b", 20), ("c", 8), ("d", 30), ("e", 5)):
        both = {one: dict.fromkeys(METRICS, rng.gamma(4.0, 2.0, size)) for one in METHODS}
        curves = {method: rng.gamma(4.0, 2.0, 10) for method in METHODS}
        made.append(ClipErrors(clip_id, "linear", both, None, curves))
    one, other = (
        summarise(clips, 10.0, 500, np.random.default_rng(0)).model_dump()
        for clips in (made, made[::-1])
    )
    assert one["clips"] == other["clips"][::-1]
    assert one | {"clips": ()} == other | {"clips": ()}


def test_scores_json(clips, small_body, score_run, tmp_path):
    rejected = Quality(verdict="rejected", reasons=("too few points",))
    manifest_path = write_clips(tmp_path / "data", small_body, clips, {"clip_1": rejected})
    path = score_run(manifest_path)
    assert path == tmp_path / "scores" / "scores.json"
    record = json.loads(path.read_text())
    assert [clip["id"] for clip in record["clips"]] == ["clip_0", "clip_2"]
    assert record["skipped"] == {"clip_1": "rejected: too few points"}
    assert set(record["camera_motion"]) == {"circular"}
    assert record["overall"]["n_motions"] == 19 + 15
    assert record["fps_hz"] == 10.0
    assert record["model"]["network"] == ModelConfig(layers=1, hidden=6).model_dump(mode="json")
    before = path.read_bytes()
    assert score_run(manifest_path) == path
    assert score_run(manifest_path, "again").read_bytes() == before
    inside = score_run(manifest_path, "run/scores")
    (inside.parent.parent / "delta_errors.json").touch()
    assert score_run(manifest_path, "run/scores") == inside, "a run's folder may hold results"
    config = ScoreConfig(all_phases=True)
    with pytest.raises(StaleOutput, match="all_phases"):
        score_run(manifest_path, "scores", config)
    score_run(manifest_path, "scores", config, run=Run(redo=True))
    record = json.loads(path.read_text())
    assert record["clips"][0]["n_motions"] == 3 * 19


def test_a_floor_is_part_of_what_was_asked(
    clips, small_body, run_dir, score_run, body_path, tmp_path, works, monkeypatch
):
    """Beside scores that are far above it, and again beside the same below it."""
    manifest_path = write_clips(tmp_path / "data", small_body, clips, kind="pseudo_gt")
    out_dir, floor_path = tmp_path / "scores", tmp_path / "floor.json"

    def scored(own_mm: float, **options: Any) -> dict[str, Any]:
        group = FLOOR_GROUP | {"ome_deg": 1e-6, "tme_mm": own_mm, "vme_mm": own_mm}
        floor = {"format": "gmrdata-floor/1", "fps_hz": 10.0, "seed": None, "recipe": {}}
        floor |= {"sequences": [], "classes": {}, "overall": group}
        write_json(floor_path, floor)
        path = score_run(manifest_path, floor_path=floor_path, **options)
        return dict(json.loads(path.read_text()))

    above = scored(1e-3)
    assert above["statements"] == []
    assert above["overall"]["floor"]["tme_mm"] == above["clips"][0]["floor"]["tme_mm"] == 1e-3
    with pytest.raises(StaleOutput, match="floor"):
        scored(1e6)
    below = scored(1e6, run=Run(redo=True))
    assert below["overall"]["below_floor"] == ["tme_mm", "vme_mm"]
    # Three clips, two classes, and all.
    assert len(below["statements"]) == 3 + 2 + 1
    assert below["overall"]["pooled_over_motions"] == above["overall"]["pooled_over_motions"]
    asked = ("evaluate", run_dir, manifest_path, "--out", out_dir, "--body", body_path)
    monkeypatch.setattr(answers, "width", 200)  # a narrow table breaks its headings
    said = " ".join(works(*asked, "--floor", floor_path).stdout.split())
    assert "pseudo ground truth's own" in said and "0.00 / 1000000.0 / 1000000.0 (all)" in said
    assert below["statements"][0] in said


def test_the_best_weights_are_scored_when_asked_for(
    clips, small_body, run_dir, score_run, tmp_path
):
    manifest_path = write_clips(tmp_path / "data", small_body, clips)
    best = ScoreConfig(which="best")
    with pytest.raises(BadCheckpoint, match="no best weights"):
        score_run(manifest_path, "none", best)
    assert not (tmp_path / "none").exists()
    add_best_weights(run_dir)
    found = {
        which: json.loads(score_run(manifest_path, which, config).read_text())
        for which, config in {"latest": ScoreConfig(), "best": best}.items()
    }
    assert [
        (found[w]["model"]["which"], found[w]["model"]["step"]) for w in ("latest", "best")
    ] == [("latest", 2), ("best", 1)]
    tme_mm = {w: found[w]["overall"]["pooled_over_motions"]["predicted"]["tme_mm"] for w in found}
    zero_mm = found["best"]["overall"]["pooled_over_motions"]["zero"]["tme_mm"]
    assert tme_mm["best"] == pytest.approx(zero_mm)
    assert tme_mm["latest"] > 1.1 * zero_mm or tme_mm["latest"] < 0.9 * zero_mm


def add_best_weights(run_dir: Path) -> None:
    """A later checkpoint, and weights of step 1 that put out zeros as the best so far."""
    model, optimizer = stepped_gmr(ModelConfig(layers=1, hidden=6), seed=1)
    zeros = Gmr(model.config)
    for parameter in zeros.parameters():
        torch.nn.init.zeros_(parameter)
    best = best_of(None, 1, "held_out_tme_mm", 1.0, zeros)
    keep_gmr(run_dir, 2, model, optimizer, best=best)


def test_the_camera_does_not_matter(clips, small_body, run_dir):
    """The prediction for a clip is the same, whatever its root does."""
    gmr: TrainedGmr = load_gmr(run_dir)
    clip = clips[0]
    still = replace(clip.motion, root_rotmats=np.tile(np.eye(3), (60, 1, 1)))
    found = [scored_by(gmr, small_body, one) for one in (clip, replace(clip, motion=still))]
    assert not np.allclose(found[0].errors["zero"]["ome_deg"], 0)
    np.testing.assert_allclose(found[1].errors["zero"]["ome_deg"], 0, atol=1e-9)


def test_a_network_is_seen_by_the_cameras_of_clips_of_any_rate(walk, small_body, run_dir):
    """Of 25 fps, which is no multiple of 10, the truth was said to have no camera, and
    accelerations were those in the world."""
    motion = walk(25.0, 45)
    turns = Rotation.from_euler("z", 1.6 * np.arange(45)[:, None], degrees=True).as_matrix()
    path = CameraPath(np.eye(3), 1, 1, rigid(turns, np.zeros(3)), np.ones(45, bool))
    clip = replace(bare_clip("walk", motion), camera=path)
    gmr: TrainedGmr = load_gmr(run_dir)
    found = network_clip(gmr, UsableClip(clip, "panning"), Pairing(10.0))
    assert isinstance(found, PredictedClip)
    ((run,),) = found.worlds
    expected = Rotation.from_euler("z", -4.0 * np.arange(18)[:, None], degrees=True).as_matrix()
    np.testing.assert_allclose(run.true_cam_rotmats, expected, atol=1e-12)
    assert clip_errors(found, small_body, PROTOCOLS["vibe"]).seen_in == "true_camera"
    # One that is not known between two frames of the network is not known.
    for row, is_known in ((43, False), (44, True)):
        lost = with_camera(clip, has_camera=np.arange(45) != row)
        found = network_clip(gmr, UsableClip(lost, "panning"), Pairing(10.0))
        assert isinstance(found, PredictedClip)
        assert (found.worlds[0][0].true_cam_rotmats is not None) == is_known


def test_clips_of_another_body_or_without_motions_are_refused(
    clips, small_body, score_run, tmp_path
):
    other = replace(clips[0], motion=replace(clips[0].motion, body="giant"))
    manifest_path = write_clips(tmp_path / "giant", small_body, [other])
    with pytest.raises(BadManifest, match="clip clip_0: of body giant"):
        score_run(manifest_path)
    flicker = replace(clips[0], valid=np.arange(60) % 2 == 0)
    manifest_path = write_clips(tmp_path / "flicker", small_body, [flicker])
    said = "no clip can be scored. Clip clip_0: no two valid frames in a row at 10 fps"
    with pytest.raises(BadManifest, match=said):
        score_run(manifest_path)
    assert not (tmp_path / "scores").exists()


def test_clips_are_scored_one_by_one(clips, small_body, score_run, tmp_path, monkeypatch):
    """All of CMU at once were 7 GB."""
    many = [replace(clips[0], id=f"clip_{n}") for n in range(5)]
    manifest_path = write_manifest_of(tmp_path / "data", small_body, many)
    in_memory, _ = counted_clips(monkeypatch)
    scores = Scores.read(score_run(manifest_path))
    assert len(scores.clips) == len(in_memory) == 5
    assert max(in_memory) <= 2


def test_the_truth_as_a_prediction_scores_zero_in_all_files(
    clips, small_body, body_path, tmp_path, works
):
    """By the verb: JSON, CSV, Markdown and HTML, a protocol's figures among them."""
    manifest_path = write_clips(tmp_path / "data", small_body, clips)
    out_dir = tmp_path / "scores"
    flags = ("--out", out_dir, "--body", body_path, "--protocol", "wham")
    works("evaluate", tmp_path / "data", manifest_path, *flags)
    record = json.loads((out_dir / "scores.json").read_text())
    assert record["format"] == "gmrdata-scores/4"
    assert record["model"] == {"kind": "files", "predictions": "data"}
    assert record["overall"]["pooled_over_motions"]["predicted"]["tme_mm"] < 1e-6
    assert record["overall"]["protocol"]["predicted"]["w_mpjpe_mm"] < 1e-6
    assert record["overall"]["protocol"]["zero"]["w_mpjpe_mm"] > 10
    assert len(record["overall"]["protocol_interval95"]["zero"]["rte_percent"]) == 2
    assert record["clips"][0]["protocol_fps_hz"] == 30.0
    assert max(record["over_time"]["predicted"]["vertex_mm"]) < 1e-6
    with (out_dir / "scores.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["name"] for row in rows] == [
        "clip_0", "clip_1", "clip_2", "circular", "linear", "all",
    ]  # fmt: skip
    assert float(rows[-1]["zero_w_mpjpe_mm"]) == record["overall"]["protocol"]["zero"]["w_mpjpe_mm"]
    assert rows[0]["zero_w_mpjpe_mm_low"] == "" and float(rows[-1]["zero_w_mpjpe_mm_low"]) > 0
    page, text = (out_dir / "scores.html").read_text(), (out_dir / "scores.md").read_text()
    for part in ("W-MPJPE [mm]", "Protocol wham follows yohanshin/WHAM", "over a gap"):
        assert part in page and part in text
    assert page.count("<svg") == 1 and "http" not in page.replace("http://www.w3.org", "")
    assert (out_dir / "over_time.png").read_bytes().startswith(b"\x89PNG")


def test_predictions_that_are_missing(clips, small_body, body_path, tmp_path):
    manifest_path = write_clips(tmp_path / "data", small_body, clips)
    write_clips(tmp_path / "vibe_cam" / "predictions", small_body, clips[:1])
    given = (tmp_path / "vibe_cam" / "predictions", manifest_path, tmp_path / "scores")
    lacks = pytest.raises(BadMotionFile, match=r"predictions: no prediction clip_1\.npz.* 1 more")
    for look in (partial(plan_scores, *given[:2], ScoreConfig()), partial(score, *given)):
        with lacks:
            look()
    assert not (tmp_path / "scores").exists()
    dropping = ScoreConfig(missing="drop")
    assert plan_scores(*given[:2], dropping) == [("vibe_cam", "1", "60", "2")]
    record = json.loads(score(*given, dropping, body_path=body_path).scores[0].read_text())
    assert record["name"] == "vibe_cam"
    assert record["skipped"] == {
        "clip_1": "no prediction clip_1.npz", "clip_2": "no prediction clip_2.npz",
    }  # fmt: skip
    assert "clip_2: no prediction" in (tmp_path / "scores" / "scores.md").read_text()


def test_a_clip_without_a_frame_to_use_needs_no_prediction(
    clips, small_body, body_path, tmp_path, run_dir
):
    """Nobody can predict it: a baseline's folder could not be scored, and its remedy was to."""
    nothing = replace(clips[1], valid=np.zeros(60, bool))
    manifest_path = write_clips(tmp_path / "data", small_body, [clips[0], nothing, clips[2]])
    zero = predict_zero(manifest_path, tmp_path / "zero") / "predictions"
    for name, predictor in (("files", zero), ("network", run_dir)):
        (path,) = score(predictor, manifest_path, tmp_path / name, body_path=body_path).scores
        scores = Scores.read(path)
        assert [clip.id for clip in scores.clips] == ["clip_0", "clip_2"]
        assert scores.skipped == {"clip_1": "no frame is valid"}
    alone = write_manifest_of(tmp_path / "alone", small_body, [nothing])
    with pytest.raises(BadManifest, match="no usable clips. Give .* keep frames"):
        score(run_dir, alone, tmp_path / "none", body_path=body_path)


def test_predictions_of_another_body_need_that_body(
    clips, small_body, body_path, tmp_path,
    monkeypatch
):  # fmt: skip
    """A body that is 4 % larger: no motion error, but one of the vertices."""
    manifest_path = write_clips(tmp_path / "data", small_body, clips[:1])
    large = replace(
        small_body,
        name="large",
        template_m=1.04 * small_body.template_m,
        joints_template_m=1.04 * small_body.joints_template_m,
    )
    predicted = replace(clips[0], motion=replace(clips[0].motion, body="large"))
    write_clips(tmp_path / "predictions", large, [predicted])
    save_body(tmp_path / "large.npz", large)
    given = (tmp_path / "predictions", manifest_path, tmp_path / "scores")
    bodies = {"body_path": body_path, "predictions_body_path": tmp_path / "large.npz"}
    with pytest.raises(BadMotionFile, match="clip_0: its prediction is of body large"):
        score(*given, body_path=body_path)
    found = json.loads(score(*given, **bodies).scores[0].read_text())["clips"][0]["predicted"]
    assert found["tme_mm"] < 1e-6
    assert 5 < found["vme_mm"] < 40
    half = replace(with_vertices(small_body, np.arange(100)), faces=np.array([[0, 1, 2]]))
    save_body(tmp_path / "half.npz", half)
    monkeypatch.chdir(tmp_path)  # a path may be text, relative to where one is
    with pytest.raises(BadBodyFile, match="half.npz: 100 vertices"):
        score(*given[:2], tmp_path / "other", **bodies | {"predictions_body_path": "half.npz"})


def test_it_is_said_that_a_network_was_trained_on_the_scored_manifest(
    clips, small_body, body_path, tmp_path
):
    trials = zip(clips, ("05_21", "08_21", "143_21"), strict=True)
    named = [replace(clip, id=trial) for clip, trial in trials]
    known = write_manifest_of(tmp_path / "cmu", small_body, named, sources="CMU")
    others = write_clips(tmp_path / "others", small_body, clips)
    trained = {}
    for name, subjects in (("all", ()), ("but_08", (8,))):
        config = TrainConfig(
            model=ModelConfig(layers=1, hidden=6),
            loss=LossConfig(n_vertices=16),
            windows=WindowConfig(frames=8),
            data=DataConfig(held_out_subjects=subjects),
            batch_size=2,
            steps=2,
        )
        trained[name] = train([known], tmp_path / name, config, body_path=body_path)
    said = {}
    for name, manifest in (("all", others), ("all", known), ("but_08", known)):
        out = tmp_path / f"{name}_{manifest.parent.name}"
        (path,) = score(trained[name], manifest, out, body_path=body_path).scores
        said[out.name] = Scores.read(path).statements
    whole = "The network was trained on this manifest: its figures are too good."
    part = whole.replace("fest", "fest, but for clips of held-out subject 8")
    assert said == {"all_others": (), "all_cmu": (whole,), "but_08_cmu": (part,)}
    assert f"- {part}\n" in (tmp_path / "but_08_cmu" / "scores.md").read_text()


def test_a_trial_of_the_published_list_has_its_type(clips, small_body, tmp_path):
    manifest_path = write_clips(tmp_path / "data", small_body, clips)
    assert motion_types(usable_files(manifest_path)[2]) == {}
    text = manifest_path.read_text().replace("sequence: clip_1", "sequence: '99_99'")
    for dataset, sequence in (("CMU", "'02_03'"), ("AMASS", "CMU/02/02_03_poses")):
        said = text.replace("dataset: gmrdata", f"dataset: {dataset}")
        manifest_path.write_text(said.replace("sequence: clip_0", f"sequence: {sequence}"))
        assert motion_types(usable_files(manifest_path)[2]) == {"clip_0": "run/jog"}


def test_the_network_in_the_package_by_its_word(clips, small_body, body_path, tmp_path, works):
    manifest_path = write_clips(tmp_path / "data", small_body, clips[:1])
    works("evaluate", "bundled", manifest_path, "--out", tmp_path / "out", "--body", body_path)
    scores = Scores.read(tmp_path / "out" / "scores.json")
    assert scores.name == "bundled"
    assert scores.overall.paper().predicted.tme_mm < scores.overall.paper().zero.tme_mm


def test_clips_that_are_too_short_for_a_protocol_have_no_figure(
    clips, small_body, score_run, tmp_path
):
    """2 s at the network's 10 fps are less than tram's 100 frames; RTE and ERVE there are."""
    manifest_path = write_clips(tmp_path / "data", small_body, clips)
    path = score_run(manifest_path, "scores", ScoreConfig(protocol="tram"))
    record = json.loads(path.read_text())
    for row in (record["overall"], *record["clips"]):
        figures = row["protocol"]["predicted"]
        assert figures["w_mpjpe_mm"] is None and figures["rte_percent"] > 0
        # By another name, what TME is where no run is left out.
        expected = row.get("pooled_over_motions", row)["predicted"]["tme_mm"]
        assert figures["erve_mm_per_frame"] == pytest.approx(expected)
    assert record["overall"]["protocol_interval95"]["predicted"]["w_mpjpe_mm"] is None
    with path.with_name("scores.csv").open(newline="") as stream:
        assert {row["predicted_w_mpjpe_mm"] for row in csv.DictReader(stream)} == {""}
    text = path.with_name("scores.md").read_text()
    (row,) = (line for line in text.splitlines() if line.startswith("| clip_0 ") and "–" in line)
    cells = row.split("|")[6:8]
    assert [cell.strip() for cell in cells] == ["–", "–"]
    assert "published figures are of video at 30 fps, these are at 10 fps" in text
