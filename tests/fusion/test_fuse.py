"""Cameras and a network put together: from a pseudo ground truth to clips with error bars."""

import shutil
import weakref
from dataclasses import dataclass, replace
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
    FusedInputs,
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
    loop_remarks,
    result_rows,
)
from gmrdata.fusion.smoothing import SamePlace, smooth
from gmrdata.gmr.model import MeanGmr
from gmrdata.gmr.predict import (
    DoubtedMotions,
    TrainedGmr,
    deltas_at_source_rate,
    predict_with_doubt,
)
from gmrdata.stage.run import Run
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip, camera_of, load_clip, save_clip
from gmrdata.values.errors import (
    BadMotionFile,
    BadRecipe,
    BadRecord,
    MissingInput,
    StageFailed,
    StaleOutput,
)
from gmrdata.values.files import write_npz
from gmrdata.values.motion import Motion, deltas
from gmrdata.values.people import person_file
from gmrdata.values.transforms import angles_rad
from gmrdata.world.judge import PseudoGtQuality
from gmrdata.world.level import LevelEstimate
from gmrdata.world.picture_fit import PictureFit
from gmrdata.world.recipe import Doubts
from tests.fixtures.command_line import fails_cleanly
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


@pytest.mark.parametrize("fps_hz", [10.0, 30.0, 25.0])
def test_doubt_is_a_rate_whatever_that_of_the_poses(fps_hz, walk, constant):
    """Two answers that are 0.1 rad and 4 cm apart, ten times a second."""
    slow, fast = (constant([0.0, 0.2 + x, 0.0], [0.0, 0.0, 0.1 + 0.4 * x]) for x in (-0.05, 0.05))
    both = replace(slow, model=MeanGmr([slow.model, fast.model]).eval())
    motion = walk(fps_hz, 41)
    of_network = predict_with_doubt(both, walk(10.0, 41).local_rotmats).doubt
    np.testing.assert_allclose(of_network, [[0.5, 0.2]] * 40, rtol=1e-3)
    found = deltas_at_source_rate(both, motion).doubt
    np.testing.assert_allclose(found, [[0.5, 0.2]] * 40, rtol=1e-3)


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


@dataclass(frozen=True)
class Video:
    """The folder of a solved video, and what putting its people together takes."""

    folder: Path
    body: BodyModel
    network: dict[str, Path]
    body_path: Path

    @property
    def pseudo_gt(self) -> Path:
        return self.folder / "pseudo_gt"

    def save(self, clip: Clip, number: int = 0, part: str = "pseudo_gt") -> None:
        """Write a person's clip: in the world, or with the part "bodies" before the camera."""
        path = self.folder / part / f"person_{number}.npz"
        save_clip(path, clip, self.body.rest_pelvis_m(clip.motion.shape))

    def write_quality(self, **changes: Any) -> None:
        path = self.pseudo_gt / "quality.json"
        PseudoGtQuality.read(path).model_copy(update=changes).write(path)

    def fuse(self, out: str = "out", source: Path | str | None = None, **more: Any) -> Path:
        given: dict[str, Any] = {**self.network, "body_path": self.body_path}
        return fuse(source or self.pseudo_gt, self.folder.parent / out, **given | more)


@pytest.fixture
def video(tmp_path, clip, small_body, run_dir, body_path) -> Video:
    record().write(tmp_path / "delta_errors.json")
    network = {"network": run_dir, "errors_path": tmp_path / "delta_errors.json"}
    made = Video(tmp_path / "video", small_body, network, body_path)
    made.save(clip)
    quality = pseudo_gt_quality(quality_of_path(camera_of(clip)), 1.0)
    quality.write(made.pseudo_gt / "quality.json")
    return made


def test_the_folder_has_whole_clips_with_error_bars(video, clip):
    config = FuseConfig(loops=(Loop(time_s=0.0, other_time_s=2.5),), loop_sigma_m=5.0)
    made = video.fuse(source=video.folder, config=config)
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
    assert video.fuse(source=video.folder, config=config) == made


def test_people_are_read_one_by_one_and_of_a_made_folder_not_again(video, clip, monkeypatch):
    """A crowd's film held each person's frames at once, before it was known that all is made."""
    from gmrdata.fusion import fuse as stage

    (video.pseudo_gt / "quality.json").unlink()
    for number in (1, 2):
        video.save(clip, number)
    config = FuseConfig(fusion=FusionConfig(feet=False))
    met: list[weakref.ref[WorldPerson]] = []
    held = []

    def noted(person: WorldPerson, *others: Any) -> FusedClip:
        met.append(weakref.ref(person))
        held.append(sum(one() is not None for one in met))
        return fuse_person(person, *others)

    monkeypatch.setattr(stage, "fuse_person", noted)
    made = video.fuse(config=config)
    assert held == [1, 1, 1]
    monkeypatch.delattr(stage, "load_clip")
    assert video.fuse(config=config) == made


def test_people_of_the_built_in_estimator_get_the_packages_network(
    video, clip, body_path, tmp_path, monkeypatch
):
    """Once it has a record of its errors; and what was made of them goes when they do."""
    from gmrdata.fusion import fuse as stage

    network, folder = tmp_path / "network", video.folder
    shutil.copytree(video.network["network"], network)
    monkeypatch.setattr(stage, "network_dir", lambda _: network)
    fuse_own_people(folder, body_path)
    assert not (folder / "fused").exists()
    shutil.copy(video.network["errors_path"], network)
    assert fuse_own_people(folder, body_path) is None
    assert load_clip(folder / "fused" / "person_0.npz").valid.all()
    assert len(load_sigma(folder / "fused" / "sigma_0.npz")["place_sigma_m"]) == 90
    fuse_own_people(folder, None)
    assert not (folder / "fused").exists() and video.pseudo_gt.is_dir()
    fuse_own_people(folder, body_path)
    video.save(WorldPerson(clip, clip.valid).take(slice(0, 2)).clip)
    failed = fuse_own_people(folder, body_path, run=Run(redo=True))
    assert failed is not None
    assert "without the network's motions" in failed and "2 frames are too few" in failed
    assert not (folder / "fused").exists()


def fused_alone(clip: Clip, gmr: TrainedGmr, body: BodyModel, config: FusionConfig) -> FusedClip:
    person = WorldPerson(clip, seen_frames(clip))
    return fuse_person(person, WeighedGmr(gmr, record()), body, config)


def test_who_is_not_seen_has_poses_that_are_not_valid(video, clip):
    """By the clip before the camera where there is one, else as far as the world's tells."""
    valid = clip.valid.copy()
    valid[:5], valid[80:] = False, False
    valid[60:63] = False  # the camera is known there, and nobody has a pose
    late = replace(clip, valid=valid)
    seen = seen_frames(late)
    assert np.flatnonzero(~seen).tolist() == [*range(5), *range(60, 63), *range(80, 90)]
    nobody = replace(clip, valid=np.zeros(90, dtype=bool))
    assert seen_frames(nobody).all()
    video.save(late)
    before = replace(clip, valid=np.arange(90) < 85)
    video.save(before, part="bodies")
    fused = load_clip(video.fuse() / "person_0.npz")
    np.testing.assert_array_equal(fused.valid, before.valid)
    assert np.isfinite(fused.motion.pelvis_m).all()


def test_frames_in_which_the_body_lies_on_nobody_are_not_seen(video, clip):
    """They have a pose of their own, which is wrong, and were valid."""
    off = np.isin(np.arange(90), range(40, 70))
    video.save(replace(clip, valid=clip.valid & ~off))
    video.save(replace(clip, valid=np.ones(90, dtype=bool)), part="bodies")
    place_m = []
    for rows in ((), tuple(range(40, 70))):
        video.write_quality(picture_fits=(PictureFit(90, len(rows), 0.8, 0, 0.8, 0, rows),))
        made = video.fuse(f"{len(rows)}")
        expected = ~np.isin(np.arange(90), rows)
        np.testing.assert_array_equal(load_clip(made / "person_0.npz").valid, expected)
        place_m.append(load_sigma(made / "sigma_0.npz")["place_sigma_m"][60].max())
    assert place_m[1] > max(0.3, 1.2 * place_m[0])


def test_frames_of_other_times_are_not_seen(video, clip):
    """They were valid, with the motion that a network finds in steps of another length; so a film
    that goes on at half its rate fell over in its files."""
    late = np.isin(np.arange(90), range(60, 90))
    video.save(replace(clip, valid=clip.valid & ~late))
    video.save(replace(clip, valid=np.ones(90, dtype=bool)), part="bodies")
    doubts = video.folder / "doubts.json"
    times = tuple("shown 0.067 s after the image before" if one else "" for one in late)
    for reasons, rows in ((times, late), (90 * ("mirrored",), np.zeros(90, dtype=bool))):
        Doubts(frames=(reasons,), sequence=()).write(doubts)
        made = video.fuse(run=Run(redo=True))
        np.testing.assert_array_equal(load_clip(made / "person_0.npz").valid, ~rows)
    for others in ((times[1:],), ()):
        Doubts(frames=others, sequence=()).write(doubts)
        with pytest.raises(StaleOutput, match="doubts"):
            video.fuse()
        with pytest.raises(BadRecord, match="doubts.json: is of other people or frames"):
            video.fuse(run=Run(redo=True))


def test_who_never_met_a_camera_is_not_shown_beside_who_did(video, clip):
    """Such a person stood at the origin of the others' world, wherever it was."""
    (video.pseudo_gt / "quality.json").unlink()
    video.save(replace(clip, valid=np.zeros(90, dtype=bool)), 1)
    made = video.fuse()
    shown = [load_clip(made / f"person_{number}.npz").valid.any() for number in (0, 1)]
    assert shown == [True, False]


def test_who_lost_every_frame_is_not_shown_beside_the_cameras(video, clip):
    """Alone as well: such a person was valid, in a world that is not that of the cameras."""
    nobody = replace(clip, valid=np.zeros(90, dtype=bool))
    (video.pseudo_gt / "quality.json").unlink()
    shown = []
    for name, one in (("dropped", nobody), ("without", replace(clip, camera=None))):
        video.save(one)
        shown.append(load_clip(video.fuse(name) / "person_0.npz").valid.any())
    assert shown == [False, True]


def test_nobody_is_pulled_down_from_a_platform(video, clip, monkeypatch):
    """Where the world's record has feet above its floor, z = 0 is not where they stand."""
    sees_truth(monkeypatch, clip.motion)
    pelvis_m = clip.motion.pelvis_m + 0.3 * np.eye(3)[2]
    video.save(replace(clip, motion=replace(clip.motion, pelvis_m=pelvis_m)))
    off_m = []
    for above_m in (0.1, 0.3):
        video.write_quality(level=levelled(1.0, above_m))
        made = video.fuse(f"{above_m}", config=FuseConfig(fusion=OWN_FUSION))
        found_m = load_clip(made / "person_0.npz").motion.pelvis_m
        off_m.append(np.abs(found_m - pelvis_m)[:, 2].max())
    assert off_m[0] > 0.05 and off_m[1] < 0.01


def levelled(
    sigma_deg: float,
    above_m: float,
    floor_at_m: tuple[float, float] | None = None,
    floor_sigma_m: float = 0.0,
) -> LevelEstimate:
    """How level a world is whose people stand so far above its floor."""
    figures = {"sigma_deg": sigma_deg, "soles_above_m": above_m, "floor_at_m": floor_at_m}
    return LevelEstimate(cues=(), floor_sigma_m=floor_sigma_m, **figures)


@pytest.mark.parametrize(("above_m", "grows"), [(0.1, False), (0.3, True)])
def test_heights_over_who_stands_lower_and_far_away_err_by_the_level(video, above_m, grows):
    """A man on a treadmill, and a woman on the floor 4 m behind him, who says where that is."""
    sigmas_m = []
    for name, at_m in (("near", None), ("far", (0.9, 1.2))):
        video.write_quality(level=levelled(3.0, above_m, at_m))
        made = video.fuse(name, config=FuseConfig(fusion=OWN_FUSION))
        sigmas_m.append(load_sigma(made / "sigma_0.npz")["place_sigma_m"])
    more_m2 = (sigmas_m[1] ** 2 - sigmas_m[0] ** 2)[:, 2]
    np.testing.assert_allclose(sigmas_m[0][:, :2], sigmas_m[1][:, :2])
    assert (more_m2.min() > np.deg2rad(3.0) ** 2 / 2 * 2.0**2) if grows else not more_m2.any()


def test_heights_err_by_the_floor_that_nobody_saw(video):
    """Of somebody behind a desk, who stands or sits there."""
    sigmas_m = []
    for name, floor_sigma_m in (("seen", 0.0), ("hidden", 0.25)):
        video.write_quality(level=levelled(3.0, 0.0, None, floor_sigma_m))
        made = video.fuse(name, config=FuseConfig(fusion=OWN_FUSION))
        sigmas_m.append(load_sigma(made / "sigma_0.npz")["place_sigma_m"])
    more_m2 = sigmas_m[1] ** 2 - sigmas_m[0] ** 2
    np.testing.assert_allclose(more_m2, np.tile([0.0, 0.0, 0.25**2], (90, 1)), atol=1e-9)


def sees_truth(monkeypatch: pytest.MonkeyPatch, truth: Motion) -> None:
    """Every network sees the true motions."""
    from gmrdata.fusion import fuse as stage

    found = *deltas(truth.root_rotmats, truth.pelvis_m), np.zeros((truth.n_frames - 1, 2))
    monkeypatch.setattr(stage, "deltas_at_source_rate", lambda gmr, motion: DoubtedMotions(*found))


def test_one_clip_of_a_pseudo_ground_truth_is_as_in_its_folder(video, clip, monkeypatch):
    """With the frames in which that person was seen, and the errors of the world, wherever the
    command runs."""
    for number, n_seen in enumerate((85, 60)):
        seen = np.arange(90) < n_seen
        video.save(replace(clip, valid=clip.valid & seen), number)
        video.save(replace(clip, valid=seen), number, "bodies")
    quality = PseudoGtQuality.read(video.pseudo_gt / "quality.json")
    fields = ("people", "picture_fits", "distance_sigmas")
    video.write_quality(scale_sigma=0.3, **{name: 2 * getattr(quality, name) for name in fields})
    monkeypatch.chdir(video.pseudo_gt)
    whole = video.fuse("whole", ".")
    alone = video.fuse("alone", "person_1.npz")
    assert load_clip(alone / "person_0.npz").valid.sum() == 60
    sigmas = load_sigma(whole / "sigma_1.npz"), load_sigma(alone / "sigma_0.npz")
    for key, wanted in sigmas[0].items():
        np.testing.assert_array_equal(sigmas[1][key], wanted)
    assert sigmas[1]["place_sigma_m"].max() > 0.2, "the scale's error"
    (video.pseudo_gt / "quality.json").unlink()
    video.fuse("of_anybody", ".")
    assert plan("person_1.npz", config=FuseConfig(), **video.network)
    quality.write(video.pseudo_gt / "quality.json")
    with pytest.raises(BadRecord, match="knows no person 1"):
        video.fuse()


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


def test_errors_of_networks_of_another_frame_rate_are_refused(video):
    """They were believed, though errors over other steps grow otherwise."""
    record().model_copy(update={"fps_hz": 5.0}).write(video.network["errors_path"])
    said = r"delta_errors\.json: of networks of 5 fps, and run is of 10 fps\. Measure"
    with pytest.raises(BadRecipe, match=said):
        video.fuse()
    with pytest.raises(BadRecipe, match=said):
        plan(video.pseudo_gt, config=FuseConfig(), **video.network)


def test_what_lies_beside_a_runs_checkpoints_makes_nothing_stale(video):
    run_dir = video.network["network"]
    made = video.fuse()
    (run_dir / "scores").mkdir()
    record().write(run_dir / "delta_errors.json")
    assert video.fuse() == made
    record(fast=0.3).write(video.network["errors_path"])
    with pytest.raises(StaleOutput, match=r"values of inputs\.errors\."):
        video.fuse()
    assert WeighedGmr.load(FusedInputs.of(video.pseudo_gt, run_dir), "latest").errors == record()


def test_frames_that_are_not_valid_may_lack_a_pose(video, clip):
    """As the manifest's format has it; a clip with such frames was refused."""
    local_rotmats = clip.motion.local_rotmats.copy()
    local_rotmats[[*range(20, 50), 89]] = np.nan
    valid = clip.valid & (np.arange(90) < 89)
    lacking = replace(clip, motion=replace(clip.motion, local_rotmats=local_rotmats), valid=valid)
    video.save(lacking)
    found = load_clip(video.fuse() / "person_0.npz").motion.local_rotmats
    np.testing.assert_allclose(found[valid], local_rotmats[valid], atol=1e-6)
    np.testing.assert_allclose(found[89], found[88], atol=1e-6)
    ends = angles_rad(found[19].swapaxes(-1, -2) @ found[50])
    np.testing.assert_allclose(
        angles_rad(found[19].swapaxes(-1, -2) @ found[29]), ends * 10 / 31, atol=1e-3
    )
    video.save(replace(lacking, valid=np.arange(90) != 89))
    with pytest.raises(BadMotionFile, match="frame 20 holds NaN"):
        video.fuse("wrong")


def test_a_loop_whose_ends_stay_apart_is_said(video):
    """Two times that are of no one spot were taken without a word."""
    config = FuseConfig(loops=(Loop(time_s=0.0, other_time_s=2.5),))
    made = FusionRecord.read(video.fuse(config=config) / RECORD_FILE)
    apart_m = made.people[0].loops[0].apart_m
    assert loop_remarks(made, 1.01 * apart_m / 3) == []
    (said,) = loop_remarks(made, 0.01)
    assert said.startswith(f"walk: at 0.00 s and 2.50 s it is {apart_m:.2f} m apart, over 3 times")


def test_what_a_dry_run_says(video, tmp_path, works, gmrdata):
    config = FuseConfig(loops=(Loop(time_s=0.0, other_time_s=2.0),))
    rows = plan(video.pseudo_gt, config=config, **video.network)
    assert rows == [("walk", "90", "30", "60", "1.00", "1")]
    assert len(rows[0]) == len(HEADINGS)
    asked = ["fuse", video.pseudo_gt, "--out", tmp_path / "new", "--body", video.body_path]
    asked += ["--network", video.network["network"], "--errors", video.network["errors_path"]]
    assert works(*asked, "--dry-run").stdout.splitlines()[-1] == f"{tmp_path / 'new'}: to make"
    (tmp_path / "new").mkdir()
    (tmp_path / "new" / "notes.txt").touch()
    for do in ((), ("--dry-run",)):  # which said nothing of the folder
        fails_cleanly(gmrdata(*asked, *do), "new: is there, and no gmrdata stage made it. Pass")


def test_a_dry_run_refuses_a_rate_that_a_run_does(video, clip):
    video.save(replace(clip, motion=replace(clip.motion, fps_hz=5.0)))
    for do in (video.fuse, lambda: plan(video.pseudo_gt, config=FuseConfig(), **video.network)):
        with pytest.raises(BadMotionFile, match="5 fps is lower than 10 fps, so frames would have"):
            do()


def test_bad_input_is_refused_with_the_remedy(video, clip, tmp_path):
    with pytest.raises(MissingInput, match=r"delta-errors .*--out .*/run/delta_errors\.json$"):
        video.fuse(errors_path=None)
    with pytest.raises(MissingInput, match=r"person_0\.npz there\. Give"):
        person_clips(tmp_path)
    for number in (0, 2, 3):  # people after a gap were left out without a word
        (tmp_path / person_file(number)).touch()
    with pytest.raises(MissingInput, match=r"no person_1\.npz there beside 3 others"):
        person_clips(tmp_path)
    for other_s, said in ((17.8, "lasts 2.97 s"), (1.01, "both are frame 30")):
        config = FuseConfig(loops=(Loop(time_s=1.0, other_time_s=other_s),))
        with pytest.raises(BadRecipe, match=said):
            video.fuse(config=config)
    video.save(clip, 1)
    once = FuseConfig(loops=(Loop(time_s=0.0, other_time_s=2.0),))
    for refused in (
        lambda: video.fuse(config=once),
        lambda: plan(video.pseudo_gt, config=once, **video.network),
    ):
        with pytest.raises(BadRecipe, match=r"of one person: give its clip, like .*person_0\.npz"):
            refused()
    video.save(replace(clip, motion=replace(clip.motion, frame="camera")), part="seen")
    with pytest.raises(BadMotionFile, match="not in the world"):
        video.fuse(source=video.folder / "seen" / "person_0.npz")
    older = replace(clip, motion=replace(clip.motion, body="anny"))
    video.save(older, part="older")
    with pytest.raises(BadMotionFile, match=r"of body anny with .* given body is .* with --body"):
        video.fuse(source=video.folder / "older" / "person_0.npz")
    write_npz(tmp_path / "sigma.npz", {"format": "gmrdata-clip/1"})
    with pytest.raises(BadRecord, match="sigma.npz"):
        load_sigma(tmp_path / "sigma.npz")
    assert not (tmp_path / "out").exists()
