"""Predictions from clip files, in the world and in the camera's frame."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmrdata.cli.gmr import show_scores
from gmrdata.gmr.runs import UsableClip
from gmrdata.motion.emdb import make_emdb
from gmrdata.read.body_file import save_body
from gmrdata.score.clip_errors import ClipErrors, across_clips, clip_errors
from gmrdata.score.predictions import Pairing, PredictedClip, file_clip
from gmrdata.score.predictors import ScoreConfig
from gmrdata.score.protocol_values import WorldBody, WorldPair
from gmrdata.score.protocols import ORIGINAL, PROTOCOLS, protocol_as, with_mesh_joints
from gmrdata.score.records import Scores
from gmrdata.score.score import score
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip, camera_of, load_clip, save_clip
from gmrdata.values.errors import BadBodyFile, BadMotionFile, BadRecipe
from gmrdata.values.transforms import rigid
from gmrdata.world.compose import motion_in_camera
from tests.clip_manifests import write_clips
from tests.motion.test_emdb import content, write_sequence
from tests.motions import bare_clip, moved, walking_clips
from tests.score.made_people import made_people
from tests.smpl_models import save_smpl

B_FROM_A = rigid(
    Rotation.from_euler("xyz", [20, 30, 200], degrees=True).as_matrix(), np.array([1.0, 2.0, 3.0])
)


@pytest.fixture(scope="module")
def true(small_body) -> Clip:
    return walking_clips(small_body, ["walk"], fps_hz=30.0, duration_s=2.0)[0]


def elsewhere(clip: Clip) -> Clip:
    """The same motion in another world."""
    return replace(clip, motion=moved(clip.motion, B_FROM_A))


def read(
    folder: Path, body: BodyModel, true: Clip, predicted: Clip, **options: Any
) -> PredictedClip:
    save_clip(folder / f"{true.id}.npz", predicted, body.rest_pelvis_m(predicted.motion.shape))
    found = file_clip(folder, UsableClip(true, "linear"), Pairing(10.0, **options))
    assert isinstance(found, PredictedClip)
    return found


def test_the_truth_in_another_world_has_no_error(tmp_path, small_body, true):
    found = read(tmp_path, small_body, true, elsewhere(true))
    assert [run.true.n_frames for run in found.runs] == [20]
    assert [[run.true.n_frames for run in world] for world in found.worlds] == [[60]]
    errors = clip_errors(found, small_body, PROTOCOLS["wham"])
    for values in (*errors.errors["predicted"].values(), errors.over_time_mm["predicted"]):
        np.testing.assert_allclose(values, 0, atol=1e-6)
    assert errors.protocol_fps_hz == 30.0
    for metric in ("w_mpjpe_mm", "wa_mpjpe_mm", "rte_percent", "roe_deg", "erve_mm_per_frame"):
        np.testing.assert_allclose(errors.protocol["predicted"][metric], 0, atol=1e-5)
        assert errors.protocol["zero"][metric].mean() > 1


def test_frames_without_a_prediction_are_an_error_or_dropped(tmp_path, small_body, true):
    """Rows without a prediction may hold NaN."""
    has = ~np.isin(np.arange(60), [30, 31])
    other = elsewhere(true).motion
    blanked = replace(
        other,
        root_rotmats=np.where(has[:, None, None], other.root_rotmats, np.nan),
        pelvis_m=np.where(has[:, None], other.pelvis_m, np.nan),
    )
    holed = replace(true, motion=blanked, valid=has)
    with pytest.raises(BadMotionFile, match=r"walk\.npz: no prediction for 2 of 60 .* row 30"):
        read(tmp_path, small_body, true, holed)
    found = read(tmp_path, small_body, true, holed, drop_missing=True)
    assert found.dropped_frames == 2
    # 0, 3, ..., 27, then 32, 35, ..., 59; one world at the full rate.
    assert [run.true.n_frames for run in found.runs] == [10, 10]
    assert [[run.true.n_frames for run in world] for world in found.worlds] == [[30, 28]]
    np.testing.assert_array_equal(
        found.runs[1].true.pelvis_m, true.motion.pelvis_m[np.arange(32, 60, 3)]
    )
    errors = clip_errors(found, small_body, PROTOCOLS["wham"])
    assert errors.n_motions == 9 + 9
    assert len(errors.protocol["predicted"]["erve_mm_per_frame"]) == 29 + 27
    np.testing.assert_allclose(errors.protocol["predicted"]["rte_percent"], 0, atol=1e-6)


def test_a_prediction_that_ends_early_lacks_frames(tmp_path, small_body, true):
    short = bare_clip("walk", elsewhere(true).motion.take(slice(0, 50), 30.0))
    with pytest.raises(BadMotionFile, match="no prediction for 10 of 60"):
        read(tmp_path, small_body, true, short)
    found = read(tmp_path, small_body, true, short, drop_missing=True)
    assert (found.dropped_frames, found.runs[0].true.n_frames) == (10, 17)


def test_frames_that_the_truth_lacks_are_not_missed(tmp_path, small_body, true):
    gap = replace(true, valid=np.arange(60) != 30)
    found = read(tmp_path, small_body, gap, replace(elsewhere(gap), valid=np.ones(60, bool)))
    assert found.dropped_frames == 0
    assert [run.true.n_frames for run in found.runs] == [10, 10]


def test_a_prediction_at_a_lower_rate(tmp_path, small_body, true):
    """Every third row at 10 fps; a gap of the truth between two of them is still a gap."""
    slow = bare_clip("walk", elsewhere(true).motion.take(slice(0, None, 3), 10.0))
    found = read(tmp_path, small_body, true, slow)
    assert [run.true.n_frames for run in found.runs] == [20]
    assert found.worlds[0][0].true.fps_hz == 10.0
    np.testing.assert_allclose(
        clip_errors(found, small_body).errors["predicted"]["tme_mm"], 0, atol=1e-6
    )
    gap = replace(true, valid=np.arange(60) != 31)  # between rows 10 and 11 of the prediction
    found = read(tmp_path, small_body, gap, slow)
    assert [run.true.n_frames for run in found.runs] == [11, 8]
    assert found.dropped_frames == 0


def test_a_protocols_rate_is_taken_where_it_divides(tmp_path, small_body, true):
    rates = {}
    for wanted_hz in (10.0, 20.0, 30.0, None):
        found = read(tmp_path, small_body, true, elsewhere(true), protocol_fps_hz=wanted_hz)
        rates[wanted_hz] = found.worlds[0][0].predicted.fps_hz
    assert rates == {10.0: 10.0, 20.0: 30.0, 30.0: 30.0, None: 30.0}


def test_a_prediction_of_too_low_a_rate_is_named(tmp_path, small_body, true):
    """The truth was, whose rate is no lower."""
    slow = bare_clip("walk", true.motion.take(slice(0, None, 6), 5.0))
    said = r"walk\.npz: 5 fps is lower than 10 fps.* Predict at a higher rate, or pass --fps-hz 5"
    with pytest.raises(BadMotionFile, match=said):
        read(tmp_path, small_body, true, slow)


@pytest.mark.parametrize(("name", "original"), [("wham", ()), ("slahmr", ("people",)),
                                                ("vibe", ("all",))])  # fmt: skip
def test_runs_that_are_too_short_at_a_protocols_rate_have_no_figure_of_it(
    name, original, tmp_path, small_body, true
):
    """Two rows at 60 fps are none at 30: it was an IndexError."""
    motion = replace(true.motion, fps_hz=60.0)
    short = replace(true, motion=motion, valid=np.isin(np.arange(60), [10, 11]))
    protocol = protocol_as(name, original)
    save_clip(tmp_path / "walk.npz", short, small_body.rest_pelvis_m(motion.shape))
    found = file_clip(tmp_path, UsableClip(short, "none"), Pairing(60.0, protocol_fps_hz=30.0))
    assert isinstance(found, PredictedClip) and found.worlds == ()
    (errors,) = across_clips([clip_errors(found, small_body, protocol)], protocol, {})
    assert errors.n_motions == 1 and errors.protocol_fps_hz == 30.0 and errors.seen_in is None
    assert [len(values) for values in errors.protocol["zero"].values()] == [0] * len(
        protocol.metrics
    )


def test_what_can_not_be_scored_is_named(tmp_path, small_body, true):
    other = elsewhere(true)
    nan = replace(other, motion=replace(other.motion, pelvis_m=other.motion.pelvis_m.copy()))
    nan.motion.pelvis_m[7, 1] = np.nan
    long = bare_clip("walk", other.motion.take(np.r_[0:60, 0:5], 30.0))
    refused = {
        "holds clip run": replace(other, id="run"),
        "in the camera's frame": replace(other, motion=replace(other.motion, frame="camera")),
        "no multiple": replace(other, motion=replace(other.motion, fps_hz=25.0)),
        r"walk\.npz: frame 7 holds NaN": nan,
        "65 frames, but the clip has 60": long,
    }
    for message, clip in refused.items():
        with pytest.raises(BadMotionFile, match=message):
            read(tmp_path, small_body, true, clip)
    (tmp_path / "walk.npz").write_bytes(b"PK\x03\x04 cut off")
    with pytest.raises(BadMotionFile, match=r"walk\.npz"):
        file_clip(tmp_path, UsableClip(true, "linear"), Pairing(10.0))


def test_a_single_clip_is_not_taken_for_an_amass_file(tmp_path, small_body, true):
    """Its frame, its valid rows and its shape would go: 319 mm of TME for a true motion."""
    manifest = write_clips(tmp_path / "data", small_body, [true])
    path = tmp_path / "data" / f"{true.id}.npz"
    with pytest.raises(BadMotionFile, match="a clip of gmrdata's own.*give the folder"):
        score(path, manifest, tmp_path / "out")


@pytest.fixture(scope="module")
def person(small_body) -> tuple[Clip, Clip]:
    return made_people(small_body, 1, gaps=True)[0]


def scored(
    folder: Path, body: BodyModel, true: Clip, predicted: Clip, name: str, *original: str
) -> ClipErrors:
    found = read(folder, body, true, predicted, protocol_fps_hz=30.0)
    protocol = protocol_as(name, original)  # type: ignore[arg-type]
    return clip_errors(found, body, protocol)


def in_camera(clip: Clip, seen_by: Clip) -> Clip:
    """A clip's motion in the frame of a clip's camera, without a camera of its own."""
    motion = motion_in_camera(clip.motion, camera_of(seen_by).world_from_cam)
    return replace(clip, motion=motion, camera=None)


def means(errors: ClipErrors) -> dict[str, float]:
    return {key: float(values.mean()) for key, values in errors.protocol["predicted"].items()
            if len(values)}  # fmt: skip


def test_the_truth_in_the_cameras_frame_has_no_error(tmp_path, small_body, person):
    true = person[0]
    seen = in_camera(replace(true, valid=np.ones(250, bool)), true)
    for name in ("wham", "emdb", "vibe"):
        found = scored(tmp_path, small_body, true, seen, name, "camera")
        assert found.seen_in == "own_camera"
        for metric, figure in means(found).items():
            if not metric.startswith(("jitter", "accel_mm", "foot")):  # the truth has some too
                assert figure == pytest.approx(0, abs=2e-4), metric
    # The truth's camera is no prediction of a camera.
    found = scored(tmp_path, small_body, true, seen, "tram", "camera")
    assert "ate_m" not in means(found) and "mpjpe_mm" in means(found)


def test_a_camera_of_its_own_changes_mpjpe_and_not_pa_mpjpe(tmp_path, small_body, person):
    true, predicted = person
    own = scored(tmp_path, small_body, true, predicted, "tram")
    without = replace(predicted, camera=None)
    turned = scored(tmp_path, small_body, true, without, "tram")
    assert (own.seen_in, turned.seen_in) == ("own_camera", "true_camera")
    a, b = means(own), means(turned)
    assert abs(a["mpjpe_mm"] / b["mpjpe_mm"] - 1) > 0.05
    assert a["pa_mpjpe_mm"] == b["pa_mpjpe_mm"] and a["w_mpjpe_mm"] == b["w_mpjpe_mm"]
    assert {"ate_m", "ate_s_m"} == set(a) - set(b)
    # As released code has it, there is no figure without a camera: named, and not zero.
    none = scored(tmp_path, small_body, true, without, "tram", "camera")
    assert none.seen_in is None
    assert {"mpjpe_mm", "pve_mm", "accel_error_m_per_s2"} == set(b) - set(means(none))
    blind = replace(true, camera=None)
    world = scored(tmp_path, small_body, blind, without, "tram")
    assert world.seen_in == "world"
    # Turning both alike changes no distance, and no camera's turn is in the acceleration.
    assert means(world)["mpjpe_mm"] == pytest.approx(b["mpjpe_mm"])
    assert means(world)["accel_error_m_per_s2"] != pytest.approx(b["accel_error_m_per_s2"])


def test_where_the_world_begins_changes_no_figure(tmp_path, small_body, person):
    """Soles 100 km from the origin slid by millimetres that single precision lacks there."""
    near = scored(tmp_path, small_body, *person, "wham")
    moved = [replace(one.motion, pelvis_m=one.motion.pelvis_m + 1e5) for one in person]
    far = (replace(one, motion=motion) for one, motion in zip(person, moved, strict=True))
    found = means(scored(tmp_path, small_body, *far, "wham"))
    assert found == pytest.approx(means(near), rel=1e-6)


def test_a_camera_that_stands_has_no_scale(tmp_path, small_body, person):
    true, predicted = person
    camera = camera_of(predicted)
    still = replace(camera, world_from_cam=np.tile(camera.world_from_cam[:1], (250, 1, 1)))
    found = means(scored(tmp_path, small_body, true, replace(predicted, camera=still), "tram"))
    centres_m = camera_of(true).centres_world_m
    spread_m = np.linalg.norm(centres_m - centres_m.mean(0), axis=1).mean()
    assert "ate_m" not in found and found["ate_s_m"] == pytest.approx(spread_m)
    # The truth's would be hit by a scale of 0, by any path.
    stands = replace(true, camera=replace(camera_of(true), world_from_cam=still.world_from_cam))
    found = means(scored(tmp_path, small_body, stands, predicted, "tram"))
    assert "ate_m" not in found and found["ate_s_m"] > 0.01


def test_joints_from_the_mesh(tmp_path, small_body, person):
    """A regressor that takes single vertices: the joints' errors are those of the vertices."""
    true, predicted = person
    matrix = np.zeros((24, len(small_body.template_m)))
    matrix[np.arange(24), np.arange(24)] = 1.0
    save_clip(tmp_path / f"{true.id}.npz", predicted, small_body.rest_pelvis_m(true.motion.shape))
    found = file_clip(tmp_path, UsableClip(true, "linear"), Pairing(10.0, protocol_fps_hz=30.0))
    assert isinstance(found, PredictedClip)
    protocol = with_mesh_joints(PROTOCOLS["gvhmr"], 24)
    regressed = clip_errors(found, small_body, protocol, regressor=matrix)
    plain = clip_errors(found, small_body, PROTOCOLS["gvhmr"])
    assert means(regressed)["mpjpe_mm"] != means(plain)["mpjpe_mm"]
    everything = np.eye(len(small_body.template_m))
    joints = protocol.model_copy(update={"joints": tuple(range(len(everything)))})
    whole = means(clip_errors(found, small_body, joints, regressor=everything))
    assert whole["mpjpe_mm"] == pytest.approx(whole["pve_mm"])
    assert with_mesh_joints(PROTOCOLS["slahmr"], 17).hips == (3, 2)
    on_3dpw = with_mesh_joints(PROTOCOLS["wham"], 17)
    assert on_3dpw.metrics == ("pa_mpjpe_mm", "mpjpe_mm", "pve_mm", "accel_error_m_per_s2")
    for name, n_rows, wanted in (("tram", 17, "24"), ("vibe", 24, "17 or 14")):
        with pytest.raises(BadBodyFile, match=f"{n_rows} rows, but protocol {name} takes {wanted}"):
            with_mesh_joints(PROTOCOLS[name], n_rows)  # type: ignore[index]


def test_deviations_are_switched_by_name():
    found = protocol_as("tram", ("gaps", "smoothing"))
    assert (found.gaps, found.smoothing_frames, found.camera) == ("joined", 3.0, "any")
    assert (found.original, found.deviations) == (("gaps", "smoothing"), ("camera",))
    for name, known in ORIGINAL.items():
        assert protocol_as(name, ("all",)).original == tuple(known)
        assert protocol_as(name) == PROTOCOLS[name]
    with pytest.raises(BadRecipe, match="--original people: protocol wham has no such deviation"):
        protocol_as("wham", ("people",))
    with pytest.raises(BadRecipe, match="give --protocol too"):
        ScoreConfig(original=("gaps",)).its_protocol()


def test_people_of_a_network_can_not_be_put_into_a_video():
    protocol = protocol_as("slahmr", ("people",))
    nothing = ClipErrors("a", "none", {}, pairs={"predicted": [_pair_without_frames()]})
    with pytest.raises(BadRecipe, match="Write its predictions to files"):
        across_clips([nothing], protocol, {})


def _pair_without_frames() -> WorldPair:
    one = WorldBody(np.tile(np.eye(3), (3, 1, 1)), np.zeros((3, 24, 3)), np.zeros((3, 0, 3)))
    return WorldPair(one, one, ((0, 3),), 30.0)


def test_emdb_1_and_emdb_2_in_one_run(tmp_path, small_body, capsys):
    """Poses are taken of EMDB 1, paths of EMDB 2, as its authors take them."""
    body = save_smpl(tmp_path / "smpl" / "male.npz", small_body, "male")
    body_path, root, second = tmp_path / "smpl" / "male.npz", tmp_path / "EMDB", "P7_57_rock_chair"
    write_sequence(root, content())
    write_sequence(root, content(second, emdb1=True, emdb2=False), second)
    manifest_path = make_emdb(root, str(body_path), tmp_path / "out")[0]
    folder = tmp_path / "predictions"
    folder.mkdir()
    for name in ("P0_09_outdoor_walk", second):
        true = load_clip(tmp_path / "out" / "clips" / name / "clip.npz")
        off = replace(in_camera(true, true), image_numbers=true.image_numbers)
        save_clip(folder / f"{name}.npz", off, body.rest_pelvis_m(true.motion.shape))
    config = ScoreConfig(protocol="wham", original=("all",))
    path = score(folder, manifest_path, tmp_path / "scores", config, body_path=body_path).scores[0]
    scores = Scores.read(path)
    assert {clip.id: (clip.subsets, clip.seen_in) for clip in scores.clips} == {
        "P0_09_outdoor_walk": (("EMDB 2",), "own_camera"),
        second: (("EMDB 1",), "own_camera"),
    }
    poses = scores.subset["EMDB 1"].figures("predicted")
    paths = scores.subset["EMDB 2"].figures("predicted")
    assert poses["mpjpe_mm"] == pytest.approx(0, abs=1e-4) and poses["w_mpjpe_mm"] is None
    assert paths["w_mpjpe_mm"] == pytest.approx(0, abs=1e-4) and paths["mpjpe_mm"] is None
    text = path.with_name("scores.md").read_text()
    assert "| all EMDB 1 |" in text and "--original gaps camera" in text
    assert all(clip.took_true_camera for clip in scores.clips)
    show_scores(path)
    for words in (text, capsys.readouterr().out):
        said = "2 predictions are in the camera's frame, without a camera. The true one"
        assert said in " ".join(words.split())
    # EMDB's own evaluation takes the jitter of EMDB 1 too, and nothing of EMDB 2.
    own = ScoreConfig(protocol="emdb")
    path = score(folder, manifest_path, tmp_path / "own", own, body_path=body_path).scores[0]
    poses = Scores.read(path).subset["EMDB 1"].figures("predicted")
    paths = Scores.read(path).subset["EMDB 2"].figures("predicted")
    assert poses["jitter_10m_per_s3"] is not None and poses["mpjpe_mm"] is not None
    assert paths["jitter_10m_per_s3"] is None and paths["mpjpe_mm"] is None


def test_a_regressor_file_is_checked(tmp_path, small_body, person):
    true, predicted = person
    manifest_path = write_clips(tmp_path / "data", small_body, [true])
    save_clip(tmp_path / f"{true.id}.npz", predicted, small_body.rest_pelvis_m(true.motion.shape))
    names = ("cut", "header", "huge", "zip", "small", "rows", "zeros")
    files = {name: tmp_path / f"{name}.npy" for name in names}
    files["cut"].write_bytes(b"\x93NUMPY")
    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999, 99999), }\n"
    for name, text in (("header", header[:20]), ("huge", header)):
        files[name].write_bytes(b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text)
    files["zip"].write_bytes(b"PK\x03\x04 no zip")
    np.save(files["small"], np.ones((17, 5)))
    np.save(files["rows"], np.ones((3, len(small_body.template_m))))
    np.save(files["zeros"], np.zeros((17, len(small_body.template_m))))
    said = dict.fromkeys(("cut", "header", "huge", "zip"), "not a .npy")
    said |= {"small": "Give the regressor of this mesh", "rows": "has 3 rows"}
    said["zeros"] = "its rows don't sum to 1"
    body_path = tmp_path / "body.npz"
    save_body(body_path, small_body)
    for name, message in said.items():
        with pytest.raises(BadBodyFile, match=message):
            score(
                tmp_path, manifest_path, tmp_path / f"scores_{name}",
                ScoreConfig(protocol="slahmr"), body_path=body_path,
                joint_regressor_path=files[name],
            )  # fmt: skip


def test_errors_that_no_number_holds_are_refused(tmp_path, small_body, true):
    """They were a traceback: a place of 1e200 m has no square."""
    manifest_path = write_clips(tmp_path / "data", small_body, [true])
    pelvis_m = true.motion.pelvis_m.copy()
    pelvis_m[6] = 1e200
    far = replace(true, motion=replace(true.motion, pelvis_m=pelvis_m))
    save_clip(tmp_path / "walk.npz", far, small_body.rest_pelvis_m(true.motion.shape))
    save_body(tmp_path / "body.npz", small_body)
    with (
        np.errstate(all="ignore"),
        pytest.raises(BadMotionFile, match="clip walk: tme_mm is no finite number. Look for"),
    ):
        score(tmp_path, manifest_path, tmp_path / "out", body_path=tmp_path / "body.npz")
