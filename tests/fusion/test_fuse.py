"""Cameras and a network put together: from a pseudo ground truth to clips with error bars."""

import shutil
import weakref
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gmrdata.fusion.camera_evidence import OWN_FUSION, FusionConfig
from gmrdata.fusion.fuse import (
    HEADINGS,
    FuseConfig,
    FusedClip,
    Loop,
    WeighedGmr,
    WorldPerson,
    fuse,
    fuse_own_people,
    fuse_person,
    person_clips,
    plan,
    seen_frames,
)
from gmrdata.fusion.record import (
    RECORD_FILE,
    RESULT_HEADINGS,
    FusionRecord,
    load_sigma,
    result_rows,
)
from gmrdata.fusion.smoothing import SamePlace, smooth
from gmrdata.gmr.predict import DoubtedMotions, TrainedGmr, deltas_at_source_rate
from gmrdata.stage.run import Run
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip, camera_of, load_clip, save_clip
from gmrdata.values.errors import BadMotionFile, BadRecipe, BadRecord, MissingInput, StageFailed
from gmrdata.values.files import write_npz
from gmrdata.values.motion import Motion, deltas
from gmrdata.values.motion_metrics import angles_rad
from gmrdata.world.judge import PseudoGtQuality
from gmrdata.world.level import LevelEstimate
from gmrdata.world.picture_fit import PictureFit
from tests.fusion.test_camera_evidence import clip_of
from tests.fusion.test_network_evidence import record
from tests.reconstructions import pseudo_gt_quality, quality_of_path
from tests.world.test_level import standing_still

GAP = slice(20, 50)


@pytest.mark.parametrize("fps_hz", [10.0, 30.0, 25.0])
def test_motions_at_the_poses_rate_are_shares_of_the_networks(fps_hz, walk, constant):
    motion = walk(fps_hz, 41)
    found, found_m, doubt = deltas_at_source_rate(
        constant([0.0, 0.2, 0.0], [0.0, 0.0, 0.1]), motion
    )
    assert found.shape == (40, 3, 3)
    np.testing.assert_allclose(angles_rad(found), 0.2 * 10 / fps_hz, rtol=1e-5)
    assert doubt.tolist() == [[0.0, 0.0]] * 40, "one answer"
    # Along the arc's chord; at a lower rate than the steps', in straight pieces.
    np.testing.assert_allclose(np.linalg.norm(found_m, axis=1), 0.1 * 10 / fps_hz, rtol=0.01)


def test_too_few_poses_are_refused(walk, untrained):
    with pytest.raises(BadMotionFile, match="Give a longer motion"):
        deltas_at_source_rate(untrained, walk(30.0, 3))


@pytest.fixture
def clip(walk) -> Clip:
    """A walk of 3 s before a camera that is lost for a second."""
    whole = clip_of(walk(30.0, 90))
    has_camera = np.ones(90, dtype=bool)
    has_camera[GAP] = False
    assert whole.camera is not None
    return replace(whole, valid=has_camera, camera=replace(whole.camera, has_camera=has_camera))


@pytest.fixture
def pseudo_gt(tmp_path, clip, small_body) -> Path:
    folder = tmp_path / "video" / "pseudo_gt"
    folder.mkdir(parents=True)
    save_clip(folder / "person_0.npz", clip, small_body.rest_pelvis_m(clip.motion.shape))
    assert clip.camera is not None
    pseudo_gt_quality(quality_of_path(clip.camera), 1.0).write(folder / "quality.json")
    return folder


@pytest.fixture
def errors_path(tmp_path) -> Path:
    record().write(tmp_path / "delta_errors.json")
    return tmp_path / "delta_errors.json"


def test_the_folder_has_whole_clips_with_error_bars(
    pseudo_gt, clip, run_dir, body_path, errors_path, tmp_path
):
    config = FuseConfig(loops=(Loop(time_s=0.0, other_time_s=2.5),), loop_sigma_m=5.0)
    given: dict[str, Any] = {"network": run_dir, "body_path": body_path, "config": config}
    given["errors_path"] = errors_path
    made = fuse(pseudo_gt.parent, tmp_path / "out", **given)
    person = FusionRecord.read(made / RECORD_FILE).people[0]
    assert (person.frames, person.frames_with_camera) == (90, 60)
    assert [(gap.start, gap.stop) for gap in person.gaps] == [(20, 50)]
    assert person.loops[0].apart_m > 0.5
    fused = load_clip(made / "person_0.npz")
    assert fused.valid.all()
    assert fused.camera is not None
    assert fused.camera.has_camera.sum() == 60
    off_m = np.linalg.norm(fused.motion.pelvis_m - clip.motion.pelvis_m, axis=1)
    assert off_m[clip.valid].max() < 0.02
    sigma = load_sigma(made / "sigma_0.npz")
    np.testing.assert_array_equal(sigma["has_camera"], clip.valid)
    place_m = sigma["place_sigma_m"].max(axis=1)
    assert place_m[clip.valid].max() < 0.05 < place_m[GAP].max()
    assert person.gaps[0].place_sigma_m <= place_m[GAP].max()
    assert len(result_rows(FusionRecord.read(made / RECORD_FILE))[0]) == len(RESULT_HEADINGS)
    again = fuse(pseudo_gt.parent, tmp_path / "out", **given)
    assert again == made


def test_people_are_read_one_by_one_and_of_a_made_folder_not_again(
    pseudo_gt, run_dir, errors_path, body_path, tmp_path, monkeypatch
):
    """A crowd's film held each person's frames at once, before it was known that all is made."""
    from gmrdata.fusion import fuse as stage

    (pseudo_gt / "quality.json").unlink()
    for number in (1, 2):
        shutil.copy(pseudo_gt / "person_0.npz", pseudo_gt / f"person_{number}.npz")
    given: dict[str, Any] = {"network": run_dir, "errors_path": errors_path}
    given |= {"body_path": body_path, "config": FuseConfig(fusion=FusionConfig(feet=False))}
    met: list[weakref.ref[WorldPerson]] = []
    held = []

    def noted(person: WorldPerson, *others: Any) -> FusedClip:
        met.append(weakref.ref(person))
        held.append(sum(one() is not None for one in met))
        return fuse_person(person, *others)

    monkeypatch.setattr(stage, "fuse_person", noted)
    made = fuse(pseudo_gt, tmp_path / "out", **given)
    assert held == [1, 1, 1]
    monkeypatch.delattr(stage, "load_clip")
    assert fuse(pseudo_gt, tmp_path / "out", **given) == made


def test_people_of_the_built_in_estimator_get_the_packages_network(
    pseudo_gt, clip, small_body, errors_path, run_dir, body_path, tmp_path, monkeypatch, capsys
):
    """Once it has a record of its errors; and what was made of them goes when they do."""
    from gmrdata.fusion import fuse as stage

    network, folder = tmp_path / "network", pseudo_gt.parent
    shutil.copytree(run_dir, network)
    monkeypatch.setattr(stage, "network_dir", lambda _: network)
    fuse_own_people(folder, body_path)
    assert not (folder / "fused").exists()
    shutil.copy(errors_path, network / "delta_errors.json")
    fuse_own_people(folder, body_path)
    assert load_clip(folder / "fused" / "person_0.npz").valid.all()
    assert len(load_sigma(folder / "fused" / "sigma_0.npz")["place_sigma_m"]) == 90
    fuse_own_people(folder, None)
    assert not (folder / "fused").exists() and pseudo_gt.is_dir()
    fuse_own_people(folder, body_path)
    short = replace(
        clip,
        motion=clip.motion.take(slice(0, 2)),
        valid=clip.valid[:2],
        image_numbers=clip.image_numbers[:2],
        camera=camera_of(clip).at_rows(slice(0, 2)),
    )
    save_clip(pseudo_gt / "person_0.npz", short, small_body.rest_pelvis_m(clip.motion.shape))
    fuse_own_people(folder, body_path, run=Run(redo=True))
    assert "without the network's motions" in " ".join(capsys.readouterr().err.split())
    assert not (folder / "fused").exists()


def fused_alone(clip: Clip, gmr: TrainedGmr, body: BodyModel, config: FusionConfig) -> FusedClip:
    person = WorldPerson(clip, seen_frames(clip))
    return fuse_person(person, WeighedGmr(gmr, record()), body, config)


def test_who_is_not_seen_has_poses_that_are_not_valid(
    pseudo_gt, clip, run_dir, errors_path, small_body,
    body_path, tmp_path
):  # fmt: skip
    """By the clip before the camera where there is one, else as far as the world's tells."""
    valid = clip.valid.copy()
    valid[:5], valid[80:] = False, False
    valid[60:63] = False  # the camera is known there, and nobody has a pose
    late = replace(clip, valid=valid)
    seen = seen_frames(late)
    assert np.flatnonzero(~seen).tolist() == [*range(5), *range(60, 63), *range(80, 90)]
    nobody = replace(clip, valid=np.zeros(90, dtype=bool))
    assert seen_frames(nobody).all()
    rest_pelvis_m = small_body.rest_pelvis_m(clip.motion.shape)
    save_clip(pseudo_gt / "person_0.npz", late, rest_pelvis_m)
    before = replace(clip, valid=np.arange(90) < 85)
    (pseudo_gt.parent / "bodies").mkdir()
    save_clip(pseudo_gt.parent / "bodies" / "person_0.npz", before, rest_pelvis_m)
    given: dict[str, Any] = {"network": run_dir, "errors_path": errors_path}
    made = fuse(pseudo_gt, tmp_path / "out", body_path=body_path, **given)
    fused = load_clip(made / "person_0.npz")
    np.testing.assert_array_equal(fused.valid, before.valid)
    assert np.isfinite(fused.motion.pelvis_m).all()


def test_frames_in_which_the_body_lies_on_nobody_are_not_seen(
    pseudo_gt, clip, run_dir, errors_path, small_body, body_path, tmp_path
):
    """They have a pose of their own, which is wrong, and were valid."""
    off, rest_pelvis_m = (
        np.isin(np.arange(90), range(40, 70)),
        small_body.rest_pelvis_m(clip.motion.shape),
    )
    save_clip(pseudo_gt / "person_0.npz", replace(clip, valid=clip.valid & ~off), rest_pelvis_m)
    (pseudo_gt.parent / "bodies").mkdir()
    before = replace(clip, valid=np.ones(90, dtype=bool))
    save_clip(pseudo_gt.parent / "bodies" / "person_0.npz", before, rest_pelvis_m)
    given: dict[str, Any] = {"network": run_dir, "errors_path": errors_path}
    place_m = []
    for rows in ((), tuple(range(40, 70))):
        quality = PseudoGtQuality.read(pseudo_gt / "quality.json")
        fits = (PictureFit(90, len(rows), 0.8, 0, 0.8, 0, rows),)
        quality.model_copy(update={"picture_fits": fits}).write(pseudo_gt / "quality.json")
        made = fuse(pseudo_gt, tmp_path / f"{len(rows)}", body_path=body_path, **given)
        expected = ~np.isin(np.arange(90), rows)
        np.testing.assert_array_equal(load_clip(made / "person_0.npz").valid, expected)
        place_m.append(load_sigma(made / "sigma_0.npz")["place_sigma_m"][60].max())
    assert place_m[1] > max(0.3, 1.2 * place_m[0])


def test_who_never_met_a_camera_is_not_shown_beside_who_did(
    pseudo_gt, clip, run_dir, errors_path, small_body, body_path, tmp_path
):
    """Such a person stood at the origin of the others' world, wherever it was."""
    nobody = replace(clip, valid=np.zeros(90, dtype=bool))
    (pseudo_gt / "quality.json").unlink()
    save_clip(pseudo_gt / "person_1.npz", nobody, small_body.rest_pelvis_m(clip.motion.shape))
    given: dict[str, Any] = {"network": run_dir, "errors_path": errors_path}
    made = fuse(pseudo_gt, tmp_path / "out", body_path=body_path, **given)
    shown = [load_clip(made / f"person_{number}.npz").valid.any() for number in (0, 1)]
    assert shown == [True, False]


def test_who_lost_every_frame_is_not_shown_beside_the_cameras(
    pseudo_gt, clip, run_dir, errors_path, small_body, body_path, tmp_path
):
    """Alone as well: such a person was valid, in a world that is not that of the cameras."""
    rest_pelvis_m = small_body.rest_pelvis_m(clip.motion.shape)
    nobody = replace(clip, valid=np.zeros(90, dtype=bool))
    (pseudo_gt / "quality.json").unlink()
    given: dict[str, Any] = {"network": run_dir, "errors_path": errors_path}
    shown = []
    for name, one in (("dropped", nobody), ("without", replace(clip, camera=None))):
        save_clip(pseudo_gt / "person_0.npz", one, rest_pelvis_m)
        made = fuse(pseudo_gt, tmp_path / name, body_path=body_path, **given)
        shown.append(load_clip(made / "person_0.npz").valid.any())
    assert shown == [False, True]


def test_nobody_is_pulled_down_from_a_platform(
    pseudo_gt, clip, run_dir, errors_path, small_body, body_path, tmp_path, monkeypatch
):  # fmt: skip
    """Where the world's record has feet above its floor, z = 0 is not where they stand."""
    sees_truth(monkeypatch, clip.motion)
    pelvis_m = clip.motion.pelvis_m + 0.3 * np.eye(3)[2]
    raised = replace(clip, motion=replace(clip.motion, pelvis_m=pelvis_m))
    rest_pelvis_m = small_body.rest_pelvis_m(clip.motion.shape)
    save_clip(pseudo_gt / "person_0.npz", raised, rest_pelvis_m)
    quality = PseudoGtQuality.read(pseudo_gt / "quality.json")
    given: dict[str, Any] = {"network": run_dir, "errors_path": errors_path}
    given |= {"body_path": body_path, "config": FuseConfig(fusion=OWN_FUSION)}
    off_m = []
    for above_m in (0.1, 0.3):
        level = LevelEstimate(sigma_deg=1.0, cues=(), soles_above_m=above_m)
        quality.model_copy(update={"level": level}).write(pseudo_gt / "quality.json")
        made = fuse(pseudo_gt, tmp_path / f"{above_m}", **given)
        found_m = load_clip(made / "person_0.npz").motion.pelvis_m
        off_m.append(np.abs(found_m - pelvis_m)[:, 2].max())
    assert off_m[0] > 0.05 and off_m[1] < 0.01


def sees_truth(monkeypatch: pytest.MonkeyPatch, truth: Motion) -> None:
    """Every network sees the true motions."""
    from gmrdata.fusion import fuse as stage

    found = *deltas(truth.root_rotmats, truth.pelvis_m), np.zeros((truth.n_frames - 1, 2))
    monkeypatch.setattr(stage, "deltas_at_source_rate", lambda gmr, motion: DoubtedMotions(*found))


def test_one_clip_of_a_pseudo_ground_truth_is_as_in_its_folder(
    pseudo_gt, clip, run_dir, errors_path, small_body, body_path, tmp_path, monkeypatch
):  # fmt: skip
    """With the frames in which that person was seen, and the errors of the world, wherever the
    command runs."""
    rest_pelvis_m = small_body.rest_pelvis_m(clip.motion.shape)
    (pseudo_gt.parent / "bodies").mkdir()
    for number, n_seen in enumerate((85, 60)):
        name, known = f"person_{number}.npz", clip.valid & (np.arange(90) < n_seen)
        save_clip(pseudo_gt / name, replace(clip, valid=known), rest_pelvis_m)
        before = replace(clip, valid=np.arange(90) < n_seen)
        save_clip(pseudo_gt.parent / "bodies" / name, before, rest_pelvis_m)
    quality, one = PseudoGtQuality.read(pseudo_gt / "quality.json"), {"network": run_dir}
    fields = ("people", "picture_fits", "distance_sigmas")
    both = {name: 2 * getattr(quality, name) for name in fields} | {"scale_sigma": 0.3}
    quality.model_copy(update=both).write(pseudo_gt / "quality.json")
    given: dict[str, Any] = one | {"errors_path": errors_path, "body_path": body_path}
    monkeypatch.chdir(pseudo_gt)
    whole = fuse(".", tmp_path / "whole", **given)
    alone = fuse("person_1.npz", tmp_path / "alone", **given)
    assert load_clip(alone / "person_0.npz").valid.sum() == 60
    sigmas = load_sigma(whole / "sigma_1.npz"), load_sigma(alone / "sigma_0.npz")
    for key, wanted in sigmas[0].items():
        np.testing.assert_array_equal(sigmas[1][key], wanted)
    assert sigmas[1]["place_sigma_m"].max() > 0.2, "the scale's error"
    (pseudo_gt / "quality.json").unlink()
    fuse(".", tmp_path / "of_anybody", **given)
    assert plan("person_1.npz", network=run_dir, config=FuseConfig(), errors_path=errors_path)
    quality.write(pseudo_gt / "quality.json")
    with pytest.raises(BadRecord, match="knows no person 1"):
        fuse(pseudo_gt, tmp_path / "out", **given)


def test_the_true_motions_fill_the_gap(clip, small_body, untrained, monkeypatch):
    """With a network that is right, the gap holds the truth."""
    truth = clip.motion
    sees_truth(monkeypatch, truth)
    config = FusionConfig(ground=False)
    fused = fused_alone(clip, untrained, small_body, config)
    off_m = np.linalg.norm(fused.clip.motion.pelvis_m - truth.pelvis_m, axis=1)
    assert off_m.max() < 0.02
    np.testing.assert_allclose(fused.network_m, truth.pelvis_m, atol=0.02)


@pytest.mark.parametrize(("ground", "covered"), [(True, False), (False, False), (True, True)])
def test_who_comes_back_elsewhere_is_where_they_were_seen(small_body, constant, ground, covered):
    """Between two places a person who is hidden has poses that are made up: a network sees one who
    stands, and pulled the frames in which the person was seen up to 1.6 m towards each other.  Of
    a covered lens no camera is known either."""
    motion = standing_still(small_body, 210)
    shares = np.clip((np.arange(210) - 59) / 91, 0, 1)
    rise_m = 0.0 if ground else 1.5
    pelvis_m = motion.pelvis_m + shares[:, None] * [4.0, 0.0, rise_m]
    valid = (shares <= 0) | (shares >= 1)
    clip = replace(clip_of(replace(motion, pelvis_m=pelvis_m)), valid=valid)
    if covered:
        clip = replace(clip, camera=replace(camera_of(clip), has_camera=valid))
    still = constant([0.0, 0.0, 0.0], [0.0, 0.0, 0.0])
    config = OWN_FUSION.model_copy(update={"ground": ground})
    person = WorldPerson(clip, seen=valid)
    fused = fuse_person(person, WeighedGmr(still, record()), small_body, config)
    off_m = np.linalg.norm(fused.clip.motion.pelvis_m - pelvis_m, axis=1)
    assert off_m[valid].max() < 0.05
    place_m = fused.arrays["place_sigma_m"].max(axis=1)
    assert place_m[valid].max() < 0.15 and place_m[105] > 0.5


def test_a_minute_of_a_film_is_put_together_as_if_it_were_alone(
    walk, clip, untrained, small_body, monkeypatch
):  # fmt: skip
    """Each of 46 people of a film was predicted and smoothed over all of its ten minutes."""
    from gmrdata.fusion import fuse as stage

    lengths = []
    monkeypatch.setattr(
        stage, "smooth", lambda fps, seen, *of, **how: (
            lengths.append(len(seen.known)) or smooth(fps, seen, *of, **how)
        )
    )  # fmt: skip
    film = clip_of(walk(30.0, 1800))
    assert film.camera is not None
    valid = np.zeros(1800, dtype=bool)
    valid[600:690] = clip.valid
    film = replace(film, valid=valid, camera=replace(film.camera, has_camera=np.arange(1800) < 640))
    person = WorldPerson(film, seen_frames(film))
    assert person.rows == slice(570, 720)
    fused = fuse_person(person, WeighedGmr(untrained, record()), small_body, FusionConfig())
    alone = fused_alone(person.take(person.rows).clip, untrained, small_body, FusionConfig())
    assert lengths == [150, 150]
    for of, wanted in (
        (fused.clip.motion.pelvis_m, alone.clip.motion.pelvis_m),
        (fused.clip.motion.root_rotmats, alone.clip.motion.root_rotmats),
        *((fused.arrays[key], alone.arrays[key]) for key in alone.arrays),
        (fused.clip.valid, alone.clip.valid),
    ):
        np.testing.assert_array_equal(of[570:720], wanted)
    for key in ("place_sigma_m", "turn_sigma_deg"):
        is_told = np.isfinite(fused.arrays[key]).all(axis=1)
        assert np.flatnonzero(is_told).tolist() == list(range(570, 720))
    assert not fused.clip.valid[[*range(570), *range(720, 1800)]].any()
    assert np.isfinite(fused.clip.motion.pelvis_m).all()
    looped = replace(person, loops=(SamePlace(100, 700, 0.1),))
    assert looped.rows == slice(70, 731)
    assert looped.take(looped.rows).loops == (SamePlace(30, 630, 0.1),)


def test_who_does_not_settle_is_named(clip, untrained, small_body, monkeypatch):
    """Of several people nobody was; and a video has no --loops to leave out."""
    from gmrdata.fusion import fuse as stage

    monkeypatch.setattr(stage, "smooth", partial(smooth, most_iterations=1))
    person = WorldPerson(clip, seen_frames(clip))
    remedy = ". Leave out --loops, or give a larger --loop-sigma-m"
    for one, said in (
        (person, "cameras and motions contradict each other"),
        (
            replace(person, loops=(SamePlace(0, 75, 0.1),)),
            f"cameras, motions and loops contradict each other{remedy}",
        ),
    ):
        with pytest.raises(StageFailed) as raised:
            fuse_person(one, WeighedGmr(untrained, record()), small_body, FusionConfig())
        assert str(raised.value) == f"walk: the poses didn't settle in 1 steps: {said}"


def test_a_clip_without_cameras_is_the_networks_path(clip, small_body, constant):
    gmr = constant([0.0, 0.0, 0.0], [0.0, 0.0, 0.1])
    alone = replace(clip, camera=None)
    fused = fused_alone(alone, gmr, small_body, FusionConfig(feet=False))
    path_m = fused.clip.motion.pelvis_m
    assert np.linalg.norm(path_m[-1] - path_m[0]) == pytest.approx(89 / 30, rel=1e-4)
    place_m = fused.arrays["place_sigma_m"].max(axis=1)
    assert place_m[0] < 1e-5
    assert place_m[-1] > 0.1


def test_what_a_dry_run_says(pseudo_gt, run_dir, errors_path):
    config = FuseConfig(loops=(Loop(time_s=0.0, other_time_s=2.0),))
    rows = plan(pseudo_gt, network=run_dir, config=config, errors_path=errors_path)
    assert rows == [("walk", "90", "30", "60", "1.00", "1")]
    assert len(rows[0]) == len(HEADINGS)


def test_bad_input_is_refused_with_the_remedy(
    pseudo_gt, clip, run_dir, errors_path, small_body, tmp_path
):
    def fuse_here(config: FuseConfig | None = None, source: Path = pseudo_gt, **more: Path) -> None:
        fuse(source, tmp_path / "out", network=run_dir, config=config, **more)

    with pytest.raises(MissingInput, match="gmrdata delta-errors"):
        fuse_here()
    with pytest.raises(MissingInput, match="person_0.npz"):
        person_clips(tmp_path)
    outside = FuseConfig(loops=(Loop(time_s=1.0, other_time_s=17.8),))
    with pytest.raises(BadRecipe, match="lasts 2.97 s"):
        fuse_here(outside, errors_path=errors_path)
    twice = FuseConfig(loops=(Loop(time_s=1.0, other_time_s=1.01),))
    with pytest.raises(BadRecipe, match="both are frame 30"):
        fuse_here(twice, errors_path=errors_path)
    shutil.copy(pseudo_gt / "person_0.npz", pseudo_gt / "person_1.npz")
    once = FuseConfig(loops=(Loop(time_s=0.0, other_time_s=2.0),))
    for refused in (
        lambda: fuse_here(once, errors_path=errors_path),
        lambda: plan(pseudo_gt, network=run_dir, config=once, errors_path=errors_path),
    ):
        with pytest.raises(BadRecipe, match=r"of one person: give its clip, like .*person_0\.npz"):
            refused()
    (pseudo_gt / "person_1.npz").unlink()
    seen = replace(clip, motion=replace(clip.motion, frame="camera"))
    rest_pelvis_m = small_body.rest_pelvis_m(clip.motion.shape)
    save_clip(tmp_path / "camera.npz", seen, rest_pelvis_m)
    with pytest.raises(BadMotionFile, match="not in the world"):
        fuse_here(source=tmp_path / "camera.npz", errors_path=errors_path)
    write_npz(tmp_path / "sigma.npz", {"format": "gmrdata-clip/1"})
    with pytest.raises(BadRecord, match="sigma.npz"):
        load_sigma(tmp_path / "sigma.npz")
    assert not (tmp_path / "out").exists()
