"""Other systems' results, as they write them: exact figures, people, frames, what is refused."""

import json
import shutil
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from gmrdata.cli import main
from gmrdata.cli.gmr import show_scores
from gmrdata.manifest.current import Quality, Source
from gmrdata.manifest.write import ClipAbout, ClipFiles, clip_entry, write_manifest
from gmrdata.motion.gait import embedded_motions
from gmrdata.read.body_file import save_body
from gmrdata.read.safe_pickle import load_object_npy
from gmrdata.read.systems.result import read_system
from gmrdata.score.compare import Comparison
from gmrdata.score.predictors import ScoreConfig
from gmrdata.score.records import ScoredResults, Scores
from gmrdata.score.result_files import ClipName, ResultSet, find_result_sets
from gmrdata.score.results import frames_of_rows, people_of_clips
from gmrdata.score.score import Scored
from gmrdata.score.score import score as score_predictor
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import CameraPath
from gmrdata.values.clip import Clip, camera_of, save_clip
from gmrdata.values.errors import BadManifest, BadMotionFile, BadRecipe, MissingInput, StaleOutput
from gmrdata.values.motion import Motion
from gmrdata.values.transforms import rigid
from gmrdata.world.compose import motion_in_camera
from tests.clip_manifests import a_head, write_clips
from tests.clips_in_memory import counted_clips
from tests.motions import save_bare
from tests.read import system_files as files

N, FIRST = 60, 10  # the clip's images are 10 to 69 of the video
FRAMES = np.arange(FIRST, FIRST + N)


def yaw_rotmats(angles_deg: np.ndarray) -> np.ndarray:
    rotvecs = np.deg2rad(angles_deg)[:, None] * [0, 0, 1]
    return np.asarray(Rotation.from_rotvec(rotvecs).as_matrix())


@pytest.fixture(scope="module")
def body(small_body) -> BodyModel:
    return replace(small_body, name="smpl-neutral")


@pytest.fixture(scope="module")
def true(body) -> Clip:
    """A walk with straight hands, seen by a camera that turns and travels."""
    (motion,) = embedded_motions(body, np.random.default_rng(0), count=1, fps_hz=30, duration_s=2)
    local = motion.local_rotmats.copy()
    local[:, 21:] = np.eye(3)
    times = np.linspace(0, 1, N)
    yaws = yaw_rotmats(40 * times)
    level_from_cam = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    places_m = motion.pelvis_m[0] + np.stack([2 * times, times - 7, 0.3 + 0 * times], axis=1)
    camera = CameraPath(
        np.array([[900.0, 0, 310], [0, 900, 250], [0, 0, 1]]),
        640,
        480,
        rigid(yaws @ level_from_cam, places_m),
        np.ones(N, bool),
    )
    return Clip("walk.p0", replace(motion, local_rotmats=local), np.ones(N, bool), FRAMES, camera)


@pytest.fixture(scope="module")
def data(tmp_path_factory, body, true) -> Path:
    """Folder with a manifest of the clip, and its body."""
    folder = tmp_path_factory.mktemp("data")
    write_clips(folder, body, [true], camera_motions=["linear"])
    save_body(folder / "body.npz", body)
    return folder


def rest(body: BodyModel, true: Clip) -> np.ndarray:
    return body.rest_pelvis_m(true.motion.shape)


def score(data: Path, path: Path, out: Path, **config: Any) -> Scored:
    given = {"fps_hz": 30.0, "resamples": 100} | config
    manifest = data / "manifest.yaml"
    body_path = data / "body.npz"
    return score_predictor(path, manifest, out, ScoreConfig(**given), body_path=body_path)


def only(made: Scored) -> Scores:
    (path,) = made.scores
    return Scores.read(path)


def wham(folder: Path, body: BodyModel, true: Clip, motion: Motion | None = None) -> Path:
    people = {3: (motion or true.motion, FRAMES)}
    return files.write_wham(folder / "wham_output.pkl", people, rest(body, true))


def vibe(folder: Path, body: BodyModel, true: Clip) -> Path:
    assert true.camera is not None
    path = folder / "vibe_output.pkl"
    return files.write_vibe(path, true.motion, true.camera, FRAMES, rest(body, true))


def before(motion: Motion) -> Motion:
    """The motion with 10 frames before it: GVHMR has a row for every frame of the video."""
    return motion.take(np.r_[np.zeros(FIRST, int), 0:N])


def gvhmr(folder: Path, true: Clip, motion: Motion | None = None) -> Path:
    assert true.camera is not None
    seen = before(motion or true.motion)
    cameras = true.camera.world_from_cam[np.r_[np.zeros(FIRST, int), 0:N], :3, :3]
    return files.write_gvhmr(folder / "hmr4d_results.pt", seen, np.swapaxes(cameras, 1, 2))


def prompthmr(folder: Path, true: Clip) -> Path:
    assert true.camera is not None
    return files.write_prompthmr(folder / "results.pkl", true.motion, true.camera, FRAMES)


def tram(folder: Path, body: BodyModel, true: Clip) -> Path:
    assert true.camera is not None
    return files.write_tram(folder, true.motion, true.camera, FRAMES, rest(body, true))


def slahmr(folder: Path, body: BodyModel, true: Clip) -> Path:
    assert true.camera is not None
    return files.write_slahmr(
        folder, {7: true.motion}, true.camera, rest(body, true), first_image=4, before=6
    )


WRITE: dict[str, Callable[[Path, BodyModel, Clip], Path]] = {
    "wham": wham,
    "gvhmr": lambda folder, body, true: gvhmr(folder, true),
    "prompt-hmr": lambda folder, body, true: prompthmr(folder, true),
    "vibe": vibe,
    "tram": tram,
    "slahmr": slahmr,
    "amass": lambda folder, body, true: files.write_amass(
        folder.with_name(f"{folder.name}.npz"), true.motion, rest(body, true)
    ),
}


@pytest.mark.parametrize("system", WRITE)
def test_the_truth_as_each_system_writes_it_has_no_error(system, tmp_path, data, body, true):
    WRITE[system](tmp_path / "results" / true.id, body, true)
    made = score(data, tmp_path / "results", tmp_path / "out", protocol="tram", camera="true")
    scores = only(made)
    assert made.comparison is None and isinstance(scores.model, ScoredResults)
    assert (scores.name, scores.model.system) == (system, system)
    (clip,) = scores.clips
    assert clip.n_motions == N - 1 and clip.predicted.ome_deg < 1e-4
    assert clip.predicted.tme_mm < 1e-3 < 1 < clip.zero.tme_mm
    assert clip.protocol is not None
    figures = clip.protocol.predicted
    assert figures["rte_percent"] == pytest.approx(0, abs=1e-4)
    notes = scores.model.clips[true.id].notes
    if system in ("gvhmr", "prompt-hmr"):
        assert "mean shape of smpl-neutral" in notes[0] and clip.predicted.vme_mm < 20
        assert clip.seen_in == "own_camera" and 1 < (figures["mpjpe_mm"] or 0) < 50
    else:
        assert notes == () and clip.predicted.vme_mm < 1e-3
        assert figures["w_mpjpe_mm"] is None and figures["mpjpe_mm"] == pytest.approx(0, abs=1e-2)
    has_path = system in ("tram", "slahmr", "prompt-hmr")
    assert (figures["ate_s_m"] is not None) == has_path
    if has_path:
        assert figures["ate_s_m"] == pytest.approx(0, abs=1e-6)


def test_phalps_people_are_placed_by_their_crops(tmp_path, data, body, true):
    """As its demo names the file, with the person that the picture shows best."""
    assert true.camera is not None
    seen = files.seen_person(true.motion, true.camera, body, FRAMES)
    path = files.write_joblib(
        tmp_path / f"demo_{true.id}.pkl", files.phalp_frames([seen], FIRST + N)
    )
    scores = only(score(data, path.parent, tmp_path / "out", camera="true"))
    assert isinstance(scores.model, ScoredResults) and scores.model.camera == "true"
    assert scores.model.system == "phalp" and scores.clips[0].n_motions == N - 1
    assert scores.clips[0].predicted.tme_mm < 0.5 * scores.clips[0].zero.tme_mm


def test_an_injected_error_is_measured_exactly(tmp_path, data, body, true):
    """One degree of yaw a frame too much, and 12 mm a frame along y."""
    yaws = yaw_rotmats(np.arange(N))
    turned = replace(true.motion, root_rotmats=yaws @ true.motion.root_rotmats)
    wham(tmp_path / "turned", body, true, turned)
    (clip,) = only(score(data, tmp_path / "turned", tmp_path / "a")).clips
    assert clip.predicted.ome_deg == pytest.approx(1.0, rel=1e-6)
    drift_m = 0.012 * np.arange(N)[:, None] * [0, 1, 0]
    shifted = replace(true.motion, pelvis_m=true.motion.pelvis_m + drift_m)
    wham(tmp_path / "shifted", body, true, shifted)
    (clip,) = only(score(data, tmp_path / "shifted", tmp_path / "b")).clips
    assert clip.predicted.tme_mm == pytest.approx(12.0, rel=1e-6)
    assert clip.predicted.ome_deg < 1e-4


def test_three_systems_of_one_sequence_are_compared_by_one_command(
    tmp_path, data, body, true, capsys
):
    folder = tmp_path / "results"
    wham(folder, body, true)
    drift_m = 0.012 * np.arange(N)[:, None] * [0, 1, 0]
    shifted = replace(true.motion, pelvis_m=true.motion.pelvis_m + drift_m)
    gvhmr(folder, true, shifted)
    vibe(folder, body, true)
    out = tmp_path / "out"
    given = ("--body", str(data / "body.npz"), "--fps-hz", "30", "--out", str(out))
    asked = ["evaluate", str(folder), str(data / "manifest.yaml"), *given]
    asked += ["--person", f"wham/{true.id}=3"]
    main([*asked, "--dry-run"])
    assert capsys.readouterr().out.splitlines()[-1] == f"{out}: to make"
    assert not out.exists()
    main(asked)
    capsys.readouterr()
    main([*asked, "--dry-run"])
    assert capsys.readouterr().out.splitlines()[-1] == f"{out}: made"
    shutil.rmtree(out / "gvhmr")  # the others are looked at, too
    with pytest.raises(SystemExit):
        main([*asked, "--missing", "drop", "--dry-run"])
    assert f"{out / 'vibe'}: made with other values of config.missing" in capsys.readouterr().err
    main(asked)
    found = Comparison.read(out / "comparison" / "comparison.json")
    assert found.runs == ("gvhmr", "vibe", "wham") and found.clips == (true.id,)
    tme = {row.run: row.mean_of_clips for row in found.metrics["tme_mm"]}
    assert tme["gvhmr"] == pytest.approx(12.0, abs=1e-3)
    assert tme["wham"] == pytest.approx(0.0, abs=1e-3)
    assert tme["vibe"] is not None and tme["vibe"] > 10  # the camera's own motion
    page = (out / "comparison" / "comparison.html").read_text()
    for word in ("TME", "<svg", "wham: walk.p0: wham_output.pkl, person_3", "mean shape"):
        assert word in page
    for name in found.runs:
        assert (out / name / "scores.html").is_file()
    text = (out / "vibe" / "scores.md").read_text()
    assert "the camera was taken as if it stood still" in text
    assert (
        "walk.p0: wham_output.pkl, person_3, 60 of 60 frames"
        in (out / "wham" / "scores.md").read_text()
    )


def test_sets_in_folders_beside_clips_of_gmrdata(tmp_path, data, body, true):
    folder = tmp_path / "results"
    wham(folder / "wham_v1" / true.id, body, true)
    wham(folder / "wham_v2", body, true).rename(folder / "wham_v2" / f"{true.id}.pkl")
    write_clips(folder / "ours" / "predictions", body, [true])
    made = score(data, folder, tmp_path / "out", resamples=300)
    assert made.comparison is not None
    compared = Comparison.read(made.comparison)
    assert compared.runs == ("ours", "wham_v1", "wham_v2")
    assert compared.resamples == 300, "as the scores beside it"
    with pytest.raises(ValidationError, match="seed"):  # it was one once all were scored
        score(data, folder, tmp_path / "seed", seed=2**63)
    score(data, folder / "wham_v2", tmp_path / "one")
    with pytest.raises(StaleOutput, match="one: holds what a single stage made.* another --out"):
        score(data, folder, tmp_path / "one")  # whose --redo took them all
    assert not (tmp_path / "one" / "ours").exists()
    wham(folder / "wham_v2" / true.id, body, true)
    with pytest.raises(BadMotionFile, match=r"are both wham's of clip walk\.p0"):
        score(data, folder, tmp_path / "other")


def test_several_people_need_a_name(tmp_path, data, body, true):
    still = replace(true.motion, pelvis_m=0 * true.motion.pelvis_m)
    people = {0: (still, FRAMES), 4: (true.motion, FRAMES)}
    path = files.write_wham(tmp_path / "x.pkl", people, rest(body, true))
    listed = r"person_0 \(frames 10-69, 60 of them\), person_4 .* --person walk\.p0=NAME"
    with pytest.raises(BadMotionFile, match=rf"2 people.*not said.*{listed}"):
        score(data, path, tmp_path / "out")
    with pytest.raises(BadMotionFile, match=r"no person '2' .*person_4"):
        score(data, path, tmp_path / "out", person={true.id: "2"})
    with pytest.raises(BadRecipe, match=r"--person run=4: no such clip.*Sets are wham; clips are"):
        score(data, path, tmp_path / "out", person={"run": "4"})
    for number, key in enumerate(("", true.id, f"wham/{true.id}")):
        scores = only(score(data, path, tmp_path / f"out_{number}", person={key: "4"}))
        assert scores.clips[0].predicted.tme_mm < 1e-3
    assert isinstance(scores.model, ScoredResults)
    found = scores.model.clips[true.id]
    assert (found.person, found.people, found.used_frames) == ("person_4", 2, N)


def test_people_of_one_sequence_are_told_by_names_alone(tmp_path, body, true):
    """A result of one person may be of either; the last of several is who is left."""
    first, second = (ClipName(f"walk.p{n}", "walk", str(n), 2) for n in range(2))
    later = replace(first, id="walk.p0.later")  # another part of the take
    clips = [first, later, second]

    def people(n: int, wanted: dict[str, str]) -> dict[str, str]:
        made = dict.fromkeys(range(n), (true.motion, FRAMES))
        files.write_wham(tmp_path / str(n) / "walk.pkl", made, rest(body, true))
        (found,) = find_result_sets(tmp_path / str(n), clips)
        assert isinstance(found, ResultSet)
        return {id: one.name for id, one in people_of_clips(found, clips, wanted).items()}

    with pytest.raises(BadMotionFile, match=r"one person, and which one of the 2 of walk is"):
        people(1, {})
    both_parts = {"walk.p0": "person_0", "walk.p0.later": "person_0"}
    assert people(1, {"walk.p0": "0"}) == both_parts
    assert people(2, {"wham/walk.p0": "0"}) == both_parts | {"walk.p1": "person_1"}
    with pytest.raises(BadMotionFile, match=r"person_0 is named for clips walk\.p0 and walk\.p1"):
        people(2, {"": "0"})
    with pytest.raises(BadMotionFile, match=r"3 people, and which one of the 2 .*walk\.p1"):
        people(3, {"walk.p0": "0"})
    files.write_wham(tmp_path / "id" / "walk.p1.pkl", {5: (true.motion, FRAMES)}, rest(body, true))
    (found,) = find_result_sets(tmp_path / "id", clips)
    assert isinstance(found, ResultSet)
    assert people_of_clips(found, clips, {})["walk.p1"].name == "person_5"


def test_results_of_a_rejected_clip_are_nobody_elses(tmp_path, data, body, true):
    """They were scored as another system's of the one clip that is left, with a comparison."""
    rejected = Quality(verdict="rejected", reasons=("blurred",))
    both = [true, replace(true, id="other")]
    write_clips(tmp_path / "set", body, both, {"other": rejected}, camera_motions=["linear"] * 2)
    shutil.copy(data / "body.npz", tmp_path / "set")
    folder, still = tmp_path / "results", 0 * true.motion.pelvis_m
    wham(folder / true.id, body, true)
    wham(folder / "other", body, true, replace(true.motion, pelvis_m=still))
    made = score(tmp_path / "set", folder, tmp_path / "out")
    (clip,) = only(made).clips
    assert made.comparison is None and clip.predicted.tme_mm < 1e-3
    with pytest.raises(MissingInput, match=r"other: no result named after a clip .*walk\.p0"):
        score(tmp_path / "set", folder / "other", tmp_path / "no")


@pytest.mark.parametrize("system", ["phalp", "slahmr"])
def test_a_systems_own_word_beside_the_clips_id_is_no_other_name(system, tmp_path, body, true):
    """`demo_<id>.pkl` and `<id>-all-shot-0` were not taken as named by the clip's id."""
    clips = [ClipName(f"walk.p{n}", "walk", str(n), 2) for n in range(2)]
    for clip in clips:
        if system == "phalp":
            seen = files.seen_person(true.motion, camera_of(true), body, FRAMES)
            frames = files.phalp_frames([seen], FIRST + N)
            files.write_joblib(tmp_path / f"demo_{clip.id}.pkl", frames)
        else:
            slahmr(tmp_path / f"{clip.id}-all-shot-0-0-180", body, true)
    (found,) = find_result_sets(tmp_path, clips)
    assert isinstance(found, ResultSet)
    assert people_of_clips(found, clips, {}).keys() == {"walk.p0", "walk.p1"}


def test_a_single_file_is_of_the_clip_that_it_is_named_after(tmp_path, body, true):
    """Beside clips of other sequences it was said to be named after none."""
    clips = [ClipName("a.p0", "set/a"), ClipName("b.p0", "set/b")]
    for name in ("a", "a.p0"):
        path = files.write_wham(
            tmp_path / f"{name}.pkl", {0: (true.motion, FRAMES)}, rest(body, true)
        )
        (found,) = find_result_sets(path, clips)
        assert isinstance(found, ResultSet) and found.results.keys() == {"a.p0"}
    with pytest.raises(MissingInput, match="no result named after a clip"):
        find_result_sets(path.rename(tmp_path / "c.pkl"), clips)


def test_frames_are_matched_by_number_and_the_missing_are_said(tmp_path, data, body, true):
    """Five frames lack, and ten are not the clip's."""
    rows = np.r_[0:20, 25:60]
    frames = np.r_[FRAMES[rows], 70:80]
    motion = true.motion.take(np.r_[rows, np.full(10, 59)])
    path = files.write_wham(tmp_path / "x.pkl", {0: (motion, frames)}, rest(body, true))
    with pytest.raises(BadMotionFile, match="no prediction for 5 of 60 valid frames.* row 20"):
        score(data, path, tmp_path / "out")
    scores = only(score(data, path, tmp_path / "out", missing="drop"))
    assert scores.dropped_frames == 5 and scores.clips[0].n_motions == 19 + 34
    assert scores.clips[0].predicted.tme_mm < 1e-3
    assert isinstance(scores.model, ScoredResults)
    found = scores.model.clips[true.id]
    assert (found.frames, found.used_frames) == (65, 55)
    assert (found.unused_frames, found.first_unused_frame) == (10, 70)
    other = files.write_wham(tmp_path / "y.pkl", {0: (motion, frames + 100)}, rest(body, true))
    with pytest.raises(BadMotionFile, match=r"frames 110-179, and .* frames 10-69 .*first-image"):
        score(data, other, tmp_path / "late")


def test_sets_with_other_gaps_are_compared_on_their_common_frames(
    tmp_path, data, body, true, capsys
):
    folder = tmp_path / "results"
    rows = np.r_[0:20, 25:60]
    people = {0: (true.motion.take(rows), FRAMES[rows])}
    files.write_wham(folder / "wham_output.pkl", people, rest(body, true))
    gvhmr(folder, true)
    made = score(data, folder, tmp_path / "out", missing="drop")
    assert made.comparison is not None
    assert [Scores.read(path).clips[0].n_motions for path in made.scores] == [53, 53]
    # GVHMR has all frames, and it was said that it had not.
    said = "Left out: 5 valid frames without a prediction, here or in a set beside it."
    assert f"- {said}\n" in made.scores[0].with_suffix(".md").read_text()
    show_scores(made.scores[0])
    assert said in capsys.readouterr().out.splitlines()


@pytest.mark.parametrize(
    ("images", "first_image", "expected"),
    [
        (None, None, [10, 11, -1, 13]),
        (None, 1, [9, 10, -1, 12]),
        ([1, 10, 11, 13], None, [1, 2, -1, 3]),
        ([1, 10, 11, 13], 0, [10, 11, -1, 13]),
    ],
)
def test_frames_of_images(true, images, first_image, expected):
    clip = replace(true, image_numbers=np.array([10, 11, -1, 13]))
    assert frames_of_rows(clip, images, first_image).tolist() == expected
    no_images = replace(true, image_numbers=np.full(4, -1))
    assert frames_of_rows(no_images, images, first_image).tolist() == [0, 1, 2, 3]


def test_clips_and_results_are_scored_on_the_frames_that_they_share(tmp_path, data, body, true):
    """They were not, so that their scores could not be compared."""
    folder, seen = tmp_path / "sets", np.arange(N)
    for name, valid in (("early", seen < 50), ("late", seen >= 20)):
        path = folder / name / f"{true.id}.npz"
        path.parent.mkdir(parents=True)
        save_clip(path, replace(true, valid=valid), rest(body, true))
    people = {3: (true.motion.take(slice(0, 40)), FRAMES[:40])}
    (folder / "wham").mkdir()
    files.write_wham(folder / "wham" / "wham_output.pkl", people, rest(body, true))
    made = score(data, folder, tmp_path / "out", missing="drop")
    assert made.comparison is not None
    scores = [Scores.read(path) for path in made.scores]
    assert [one.clips[0].n_motions for one in scores] == [19, 19, 19]
    again = score(data, folder, tmp_path / "out", missing="drop")
    assert again == made


@pytest.mark.parametrize(("step", "n_motions"), [(1, 11 + 6 + 34), (3, 6 + 2 + 6)])
def test_files_with_their_own_rate_are_scored_on_the_frames_that_all_share(
    step, n_motions, tmp_path, data, body, true
):
    """The file with AMASS's keys was scored on all of its own."""
    folder, fps_hz = tmp_path / "sets", 30.0 / step
    slow, rows = true.motion.take(slice(0, None, step), fps_hz), np.r_[0:20, 25:60]
    people = {3: (true.motion.take(rows), FRAMES[rows])}
    (folder / "wham").mkdir(parents=True)
    files.write_wham(folder / "wham" / "wham_output.pkl", people, rest(body, true))
    files.write_amass(folder / "mocap" / f"{true.id}.npz", slow, rest(body, true))
    without_12 = np.arange(slow.n_frames) != 12
    save_bare(folder / "ours" / f"{true.id}.npz", body, slow, without_12)
    made = score(data, folder, tmp_path / "out", missing="drop", fps_hz=fps_hz)
    assert made.comparison is not None
    assert Comparison.read(made.comparison).runs == ("mocap", "ours", "wham")
    assert [Scores.read(path).clips[0].n_motions for path in made.scores] == 3 * [n_motions]


def test_a_camera_of_the_truth_that_lacks_rows_narrows_the_rows_that_all_share(
    tmp_path, data, body, true
):
    """The comparison was refused, as if the sets were of two manifests."""
    folder, has = tmp_path / "sets", ~np.isin(np.arange(N), [20, 21])
    blind = replace(true, camera=replace(camera_of(true), has_camera=has))
    manifest = write_clips(tmp_path / "data", body, [blind])
    seen = motion_in_camera(true.motion, camera_of(true).world_from_cam)
    for name, motion in (("seen", seen), ("world", true.motion)):
        predicted = replace(true, motion=motion, camera=None)
        save_clip(folder / name / f"{true.id}.npz", predicted, rest(body, true))
    config = ScoreConfig(fps_hz=30.0, missing="drop", resamples=100)
    given = (folder, manifest, tmp_path / "out", config)
    made = score_predictor(*given, body_path=data / "body.npz")
    assert made.comparison is not None
    assert [Scores.read(path).clips[0].n_motions for path in made.scores] == [19 + 37] * 2


def test_cameras_are_compared_on_the_frames_that_all_share(tmp_path, data, body, true):
    """ATE was of all frames of each: one camera goes wrong where the other prediction ends."""
    folder, early = tmp_path / "sets", np.arange(N) < 30
    places = camera_of(true).world_from_cam.copy()
    places[:, 0, 3] += 0.01 * np.sin(np.arange(N))
    places[30:, 2, 3] += np.linspace(0, 2, 30)
    for name, valid in (("half", early), ("whole", early | True)):
        camera = replace(camera_of(true), world_from_cam=places, has_camera=valid)
        predicted = replace(true, camera=camera, valid=valid)
        save_clip(folder / name / f"{true.id}.npz", predicted, rest(body, true))
    made = score(data, folder, tmp_path / "out", missing="drop", protocol="tram")
    (half,), (whole,) = (Scores.read(path).clips for path in made.scores)
    assert half.protocol is not None and whole.protocol is not None
    ate = half.protocol.predicted["ate_s_m"]
    assert ate == pytest.approx(whole.protocol.predicted["ate_s_m"], rel=1e-9) and 0 < ate < 0.1


@pytest.mark.parametrize("missing", ["error", "drop"])
def test_a_result_that_is_named_after_another_clip_is_another_result(
    missing, tmp_path, data, body, true
):
    """It gave the scores of the clip that it had been named after."""
    clips = [replace(true, id=name) for name in "ab"]
    manifest = write_clips(tmp_path / "data", body, clips)
    files.write_amass(tmp_path / "results" / "a.npz", true.motion, rest(body, true))
    files.write_amass(tmp_path / "results" / "b.npz", before(true.motion).take(slice(N)),
                      rest(body, true))  # fmt: skip
    config = ScoreConfig(fps_hz=30.0, missing=missing, resamples=100)
    given = (tmp_path / "results", manifest, tmp_path / "out", config)
    scores = only(score_predictor(*given, body_path=data / "body.npz"))
    assert scores.clips[0].predicted.tme_mm < 1e-3 < scores.clips[1].predicted.tme_mm
    for old, new in (("a", "c"), ("b", "a"), ("c", "b")):
        (tmp_path / "results" / f"{old}.npz").rename(tmp_path / "results" / f"{new}.npz")
    with pytest.raises(StaleOutput, match="other values of inputs.result_amass/a/0, "):
        score_predictor(*given, body_path=data / "body.npz")


def test_systems_without_a_common_frame_are_refused_for_that(tmp_path, data, body, true):
    folder = tmp_path / "sets"
    for name, rows in (("early", slice(0, 30)), ("late", slice(30, 60))):
        (folder / name).mkdir(parents=True)
        people = {3: (true.motion.take(rows), FRAMES[rows])}
        files.write_wham(folder / name / "wham_output.pkl", people, rest(body, true))
    said = r"scored\. Clip walk\.p0: no two frames in a row with a prediction at 30 fps"
    with pytest.raises(BadManifest, match=said):
        score(data, folder, tmp_path / "out", missing="drop")


def test_true_clips_are_beside_results_one_by_one(tmp_path, data, body, true, monkeypatch):
    clips = [replace(true, id=f"walk_{n}") for n in range(4)]
    manifest = write_clips(tmp_path / "data", body, clips)
    for clip in clips:
        path = tmp_path / "results" / f"{clip.id}.pkl"
        path.parent.mkdir(exist_ok=True)
        files.write_wham(path, {0: (true.motion, FRAMES)}, rest(body, true))
    in_memory, _ = counted_clips(monkeypatch)
    given = (tmp_path / "results", manifest, tmp_path / "out", ScoreConfig(resamples=100))
    scores = only(score_predictor(*given, body_path=data / "body.npz"))
    assert len(scores.clips) == 4 and len(in_memory) == 8
    assert max(in_memory) <= 2


def test_an_amass_like_file_has_its_own_rate(tmp_path, data, body, true):
    slow = true.motion.take(slice(0, None, 3), 10.0)
    path = files.write_amass(tmp_path / f"{true.id}.npz", slow, rest(body, true))
    scores = only(score(data, path, tmp_path / "out", fps_hz=10.0))
    assert scores.clips[0].n_motions == 19 and scores.clips[0].predicted.vme_mm < 1e-6
    other = files.write_amass(tmp_path / f"{true.id}.npz", slow, rest(body, true), gender=b"female")
    scores = only(score(data, other, tmp_path / "female", fps_hz=10.0))
    assert isinstance(scores.model, ScoredResults)
    assert "its shape is of smpl-female" in scores.model.clips[true.id].notes[0]
    wrong = files.write_amass(
        tmp_path / f"{true.id}.npz", true.motion, rest(body, true), mocap_framerate=45.0
    )
    with pytest.raises(BadMotionFile, match="45 fps, but the truth's 30 fps"):
        score(data, wrong, tmp_path / "wrong")


def test_what_is_not_there_is_said(tmp_path, data, body, true):
    (tmp_path / "empty").mkdir()
    with pytest.raises(MissingInput, match=r"no result named after .*walk\.p0.*docs/scores\.md"):
        score(data, tmp_path / "empty", tmp_path / "out")
    with pytest.raises(MissingInput, match="nowhere: no such file"):
        score(data, tmp_path / "nowhere", tmp_path / "out")
    run = slahmr(tmp_path / true.id, body, true)
    (run / "track_info.json").unlink()
    with pytest.raises(MissingInput, match=r"no track_info\.json.*Keep SLAHMR's"):
        score(data, tmp_path, tmp_path / "out")
    for broken in ('{"tracks": {}', "[" * 100_000, '{"tracks": 3, "meta": []}', ""):
        (run / "track_info.json").write_text(broken)
        with pytest.raises(BadMotionFile, match=r"not SLAHMR's track_info\.json"):
            score(data, tmp_path, tmp_path / "out")


def test_a_person_outside_of_trams_cameras_is_refused(tmp_path, body, true):
    folder = tram(tmp_path / "run", body, true)
    camera = {"world_cam_R": np.tile(np.eye(3), (9, 1, 1)), "world_cam_T": np.zeros((9, 3))}
    np.save(folder / "camera.npy", camera)  # type: ignore[arg-type]
    with pytest.raises(BadMotionFile, match=r"frames to 69, but camera\.npy has 9 cameras"):
        read_system(folder, "world")


def test_figures_are_json(tmp_path, data, body, true):
    path = wham(tmp_path, body, true)
    (scores,) = score(data, path, tmp_path / "out").scores
    said = json.loads(scores.read_text())["model"]
    assert said["kind"] == "results" and said["clips"][true.id]["file"] == "wham_output.pkl"


def test_results_are_never_looked_for_outside_or_under_two_names(tmp_path, body, true):
    assert ClipName("a", "../../etc/..").names() == ("a",)
    assert ClipName("P0_09", "P0/09").names() == ("P0_09", "09")
    wham(tmp_path / "09", body, true)
    clips = [ClipName("P0_09", "P0/09"), ClipName("P1_09", "P1/09")]
    with pytest.raises(BadMotionFile, match="named after two sequences, P0/09 and P1/09"):
        find_result_sets(tmp_path, clips)
    (found,) = find_result_sets(tmp_path, clips[:1])
    assert (found.name, set(found.results)) == ("wham", {"P0_09"})  # type: ignore[union-attr]
    wham(tmp_path / "comparison", body, true)
    with pytest.raises(BadMotionFile, match="comparison: a set can't be called so"):
        find_result_sets(tmp_path, clips[:1])


SLAHMRS_CONFIG = """\
data:
  type: {type}
  root: /data
  video_dir: videos
  seq: walk
  ext: mp4
  src_path: ${{data.root}}/${{data.video_dir}}/${{data.seq}}.${{data.ext}}
  frame_opts:
    ext: jpg
    fps: {fps}
    start_sec: 0
    end_sec: -1
  shot_idx: 0
  name: ${{data.seq}}-${{data.track_ids}}-shot-${{data.shot_idx}}
fps: 30
"""
"""As Hydra keeps it, in part; the last rate is that of the optimizer's pictures."""


def test_slahmrs_frames_are_of_its_rate_and_of_its_shot(tmp_path, data, body, true):
    """Frames at its default of 25 Hz were taken for those of a video at 30 Hz, and those of a later
    shot for the video's first."""
    run = slahmr(tmp_path / "results" / f"{true.id}-longest-2-shot-0-0--1", body, true)
    file = run / "motion_chunks" / "x_000040_world_results.npz"
    (run / ".hydra").mkdir()

    def with_config(**said: Any) -> Path:
        text = SLAHMRS_CONFIG.format(**{"type": "video", "fps": 30} | said)
        (run / ".hydra" / "config.yaml").write_text(text)
        return run.parent

    scores = only(score(data, with_config(), tmp_path / "out"))
    assert scores.name == "slahmr" and scores.clips[0].predicted.tme_mm < 1e-3
    said = r"at 25 fps, and clip walk\.p0 is of a video at 30 fps"
    with pytest.raises(BadMotionFile, match=said):
        score(data, with_config(fps=25), tmp_path / "slow")
    assert read_system(file, "world").fps_hz == 25.0
    with_config(type="davis")
    assert read_system(file, "world").fps_hz is None
    for fps in ("fast", "-1", "[25]", "{"):
        with_config(fps=fps)
        with pytest.raises(BadMotionFile, match=r"config\.yaml: truncated or not SLAHMR's config"):
            read_system(file, "world")
    later = run.rename(run.with_name(f"{true.id}-3-7-shot-1"))
    with pytest.raises(BadMotionFile, match=r"walk\.p0-3-7-shot-1 is of a later shot.*first-image"):
        score(data, later.parent, tmp_path / "later")


def test_slahmrs_runs_are_of_the_sequence_before_their_tracks(tmp_path, body, true):
    """A run of `walk-fast` was taken for one of `walk`, too; and a run for a set of its own."""
    clips = [ClipName("walk.p0", "walk"), ClipName("walk-fast.p0", "walk-fast")]
    for n, tracks in enumerate(("all", "longest-2", "3-7")):
        run = slahmr(tmp_path / str(n) / f"walk-fast-{tracks}-shot-0-0-180", body, true)
        for named in (clips, clips[1:]):
            (found,) = find_result_sets(run.parent, named)
            assert isinstance(found, ResultSet) and found.name == "slahmr"
            assert set(found.results) == {"walk-fast.p0"}


def test_a_folder_of_many_clips_is_listed_once(tmp_path, true, body, monkeypatch):
    """It was listed once for each name of each clip."""
    clips = [ClipName(f"walk.p{n}", f"walk{n}", str(n)) for n in range(300)]
    save_clip(tmp_path / "walk.p0.npz", true, rest(body, true))
    content = (tmp_path / "walk.p0.npz").read_bytes()
    for clip in clips:
        (tmp_path / f"{clip.id}.npz").write_bytes(content)
    listed, really = [], Path.iterdir

    def iterdir(path: Path) -> Iterator[Path]:
        listed.append(path)
        return really(path)

    monkeypatch.setattr(Path, "iterdir", iterdir)
    (found,) = find_result_sets(tmp_path, clips)
    assert not isinstance(found, ResultSet) and found.folder == tmp_path
    assert len(listed) < 5


def write_with_images(folder: Path, body: BodyModel, true: Clip, numbers: Iterable[int]) -> None:
    """A manifest of the clip that lists images of these numbers."""
    (folder / "frames").mkdir()
    for number in numbers:
        (folder / "frames" / f"{number:05d}.jpg").write_bytes(b"a picture")
    save_clip(folder / "walk.npz", true, rest(body, true))
    save_body(folder / "body.npz", body)
    source = Source(dataset="gmrdata", sequence="walk")
    about = ClipAbout(camera_motion="linear", licence="CC0-1.0", source=source)
    made = ClipFiles(folder / "walk.npz", images=folder / "frames")
    entry = clip_entry(folder, made, about)
    write_manifest(folder / "manifest.yaml", a_head("clips", "motions"), [entry])


def test_phalp_of_the_first_frames_of_more_images_is_scored(tmp_path, body, true):
    """PHALP takes 1300 frames of a video by itself."""
    write_with_images(tmp_path, body, true, range(1310))
    seen = files.seen_person(true.motion, true.camera, body, FRAMES)
    frames = files.phalp_frames([seen], 1300)
    path = files.write_joblib(tmp_path / "demo_walk.pkl", frames)
    scores = only(score(tmp_path, path, tmp_path / "out", camera="true"))
    assert scores.clips[0].n_motions == N - 1
    frames.popitem()
    files.write_joblib(path, frames)
    with pytest.raises(BadMotionFile, match="a video of 1299 frames, .* has 1310 images"):
        score(tmp_path, path, tmp_path / "short", camera="true")


def test_a_result_of_other_frames_than_the_images_is_refused(tmp_path, data, body, true):
    """One of every second frame was scored as if it were of the first half."""
    write_with_images(tmp_path, body, true, FRAMES)
    assert true.camera is not None
    path, every = tmp_path / "results.pkl", np.arange(0, N, 2)
    files.write_prompthmr(path, true.motion, true.camera, np.arange(N))
    scores = only(score(tmp_path, path, tmp_path / "whole"))
    assert scores.clips[0].n_motions == N - 1 and scores.clips[0].predicted.tme_mm < 1e-3
    half = true.motion.take(every), true.camera.at_rows(every)
    files.write_prompthmr(path, *half, np.arange(len(every)))
    said = r"results\.pkl: of a video of 30 frames, and clip walk\.p0 has 60 images"
    with pytest.raises(BadMotionFile, match=said):
        score(tmp_path, path, tmp_path / "half", missing="drop")
    score(tmp_path, path, tmp_path / "said", missing="drop", first_image=FIRST)
    # WHAM does not say how long its video was: more frames than images are of another one too.
    path = tmp_path / "wham_output.pkl"
    more = np.arange(2 * N) // 2
    files.write_wham(path, {0: (true.motion.take(more), np.arange(2 * N))}, rest(body, true))
    with pytest.raises(BadMotionFile, match="of a video of 120 frames, and clip walk.p0 has 60"):
        score(tmp_path, path, tmp_path / "longer", missing="drop")


def test_tram_on_emdb_and_its_cameras(tmp_path, data, body, true):
    """`smpl/<sequence>.npz` has a row for every image, and `camera/` lies beside."""
    motion = before(true.motion)
    assert true.camera is not None
    camera = true.camera.at_rows(np.r_[np.zeros(FIRST, int), 0:N])
    rows = np.arange(FIRST + N)
    run = files.write_tram(tmp_path / "x", motion, camera, rows, rest(body, true))
    for name, made in (("smpl", "hps/hps_track_0.npy"), ("camera", "camera.npy")):
        arrays = load_object_npy(run / made)
        arrays.pop("frame", None)
        (tmp_path / "emdb" / name).mkdir(parents=True)
        np.savez(tmp_path / "emdb" / name / f"{true.id}.npz", **arrays)
    scores = only(score(data, tmp_path / "emdb", tmp_path / "out"))
    assert scores.name == "tram" and scores.clips[0].predicted.tme_mm < 1e-3
