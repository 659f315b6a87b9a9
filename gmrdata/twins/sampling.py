"""The recipe of a twin set by a seed: other motions, cameras and places for each.

What is sampled is planned before it is taken, by the code that the renderer uses: the motion is
long enough and has its feet on the floor, people stay in view, the class of the camera's motion is
beyond doubt, and there is room for everyone.
"""

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, get_args

import numpy as np

from gmrdata.film.programmes import Film, plan_clip
from gmrdata.film.scene import SceneConfig, make_cast
from gmrdata.film.set_plan import SyntheticClip, SyntheticRecipe, clip_rng, planned_clip
from gmrdata.motion.files import find_motions
from gmrdata.read.bodies import load_body
from gmrdata.stage.recipes import find_recipe, load_recipe
from gmrdata.twins.twin_set import TwinRecipe
from gmrdata.values.body import JOINT, BodyModel
from gmrdata.values.camera import in_frame, person_box
from gmrdata.values.camera_motion import MotionClass, MotionClassConfig, class_of, classify
from gmrdata.values.clip import Clip, camera_of
from gmrdata.values.errors import BadMotionFile, BadRecipe
from gmrdata.values.limits import LARGEST_SEED, LARGEST_SIDE_PX

Settings = dict[str, Any]
"""A part of a recipe."""
TUNED_ON = "twins"
"""A recipe whose trials are not sampled."""
CLASSES: tuple[MotionClass, ...] = get_args(MotionClass)
PLACES = ("courtyard", "street", "park", "room")
FILM = Film(duration_s=5.0, fps_hz=30.0, width_px=540, height_px=960, hfov_deg=30.8)
"""3DPW's portrait camera at half its size: its K says fx = 1962 px for 1080 px of width."""
SET = {
    "recipe": "synthetic",
    "name": "floor",
    "people": {"vary": True},
    "render": {"samples": 5, "shutter": 0.5, "instances": True},
}
ROOMY = (1.05, 1.25)
"""How much farther away than the nearest that frames the person the camera is."""
FARTHEST_M = 8.0
FARTHEST_IN_ROOM_M = 5.5
FOR_COMPANY_M = 1.2
"""How much farther away it is for the sake of somebody beside."""
COMPANY_EVERY = 4
COMPANY_IN_FRAME = 0.95
"""Least share of the frames with the whole company in view."""
DOUBT = 1.4
"""A class must be the same with each threshold multiplied and divided by this."""
FLOOR_M, FLOOR_SHARE = 0.15, 0.9
"""The lower foot's joint is at most this high in this share of the frames: nobody climbs."""
PLACE_TRIES = 4


def twin_recipe(
    n_sequences: int, seed: int, motions_dir: Path, *, film: Film = FILM, workers: int | None = None
) -> TwinRecipe:
    """A recipe of kind `threedpw_twin`, a function of the arguments and of the motion files alone.

    The first sequences of a longer recipe are those of a shorter one.  Six or more have cameras of
    all six classes; each fourth sequence has two people.  Each motion file is taken once; BadRecipe
    where too few are long enough and fit a camera.
    """
    if not 0 <= seed <= LARGEST_SEED:
        raise BadRecipe(f"--seed {seed}: give 0 or more, at most {LARGEST_SEED}")
    if n_sequences < 1:
        raise BadRecipe(f"{n_sequences} sequences: ask for at least one")
    given = {"seed": seed, "film": film} | ({} if workers is None else {"workers": workers})
    base = SyntheticRecipe.model_validate(SET | given)
    body = load_body(base.body)
    rng = np.random.default_rng([seed, 0])
    taken = {clip.trial for clip in load_recipe(find_recipe(TUNED_ON), TwinRecipe).set.clips}
    there = find_motions(motions_dir)
    named = Counter(path.stem for path in there)
    files = [path for path in there if path.stem not in taken and named[path.stem] == 1]
    waiting = [files[i] for i in rng.permutation(len(files))]
    classes = [CLASSES[i] for i in rng.permutation(len(CLASSES))]
    places = [PLACES[i] for i in rng.permutation(len(PLACES))]
    clips: list[SyntheticClip] = []
    unfit: dict[Path, str] = {}
    for number in range(n_sequences):
        kind = classes[number % len(classes)]
        # The round of places is shifted by one each time, so that no class keeps its place.
        place = places[(number + number // len(places)) % len(places)]
        company = int(number % COMPANY_EVERY == 1)
        wanted = _Wanted(f"{kind}_{number:02d}", kind, place, company)
        own = np.random.default_rng([seed, 1, number])
        reasons: dict[Path, str] = {}
        for path in waiting:
            clip = _sample_clip(wanted, path, base, body, own, unfit)
            if not isinstance(clip, str):
                clips.append(clip)
                waiting.remove(path)
                break
            reasons[path] = clip
        else:
            lacking = f"no motion is left for sequence {number} with a {kind} camera"
            filmed = {clip.trial for clip in clips}
            reasons |= {path: "taken by others" for path in files if path.stem in filmed}
            reasons |= {path: "called as another is" for path in there if named[path.stem] > 1}
            reasons |= {path: f"of the recipe {TUNED_ON}" for path in there if path.stem in taken}
            needed = f"Motions of {film.duration_s:g} s are needed. Give more, or ask for fewer"
            raise BadRecipe(f"{motions_dir}: {lacking}. {_in_words(reasons)}. {needed}")
    return TwinRecipe(recipe="threedpw_twin", set=base.model_copy(update={"clips": tuple(clips)}))


NAMED = 3  # files of each reason
NO_CAMERA = "without such a camera near by"


def _in_words(reasons: Mapping[Path, str]) -> str:
    """How many motions were left out for each reason, and some of them."""
    said = []
    for reason in dict.fromkeys(reasons.values()):
        names = [path.name for path, why in reasons.items() if why == reason]
        more = ", ..." if len(names) > NAMED else ""
        said.append(f"{len(names)} {reason} ({', '.join(names[:NAMED])}{more})")
    return "; ".join(said) or "There are none"


@dataclass(frozen=True)
class _Wanted:
    """What a sequence shall be."""

    id: str
    kind: MotionClass
    place: str
    company: int


def _sample_clip(
    wanted: _Wanted,
    path: Path,
    base: SyntheticRecipe,
    body: BodyModel,
    rng: np.random.Generator,
    unfit: dict[Path, str],
) -> SyntheticClip | str:
    """A sequence with this motion and class of camera, or why they don't fit each other.

    A motion that fits no sequence is put into `unfit`, and not read again.
    """
    programme = _sample_programme(wanted.kind, rng)
    roomy, scene_seeds = rng.uniform(*ROOMY), rng.integers(2**31, size=PLACE_TRIES)
    scene = _sample_scene(wanted, rng)
    given: Settings = {"id": wanted.id, "trial": path.stem, "programme": programme, "scene": scene}
    if path in unfit:  # only now: what is sampled for the next motion hangs on the above
        return unfit[path]
    try:
        planned = _planned(wanted, given, roomy, path, base, body)
    except BadMotionFile as error:
        unfit[path] = str(error).removeprefix(f"{path}: ")
        return unfit[path]
    except BadRecipe:
        return NO_CAMERA
    if isinstance(planned, str):
        return planned
    if not _in_view(planned, 1.0) or not is_beyond_doubt(planned, wanted.kind):
        return NO_CAMERA
    for scene_seed in scene_seeds:
        given["scene"] = scene | {"seed": int(scene_seed)}
        clip = SyntheticClip.model_validate(given)
        if clip.scene is not None and _has_room(clip.scene, planned, body):
            return clip
    return "without room for those beside them"


def _sample_scene(wanted: _Wanted, rng: np.random.Generator) -> Settings:
    outside = wanted.place != "room"
    extras = {
        "company": wanted.company,
        "passers_by": int(rng.random() < 0.75),
        "cars": int(outside and rng.random() < 0.6),
    }
    overcast = outside and rng.random() < 0.4
    light = {"light": "overcast"} if overcast else {}
    return {"kind": wanted.place, "extras": extras} | light


def _planned(
    wanted: _Wanted,
    given: Settings,
    roomy: float,
    path: Path,
    base: SyntheticRecipe,
    body: BodyModel,
) -> Clip | str:
    """The clip from so many times the nearest distance that frames the person, which `given` gets.

    Why not where nobody stands on the floor, or the camera would be too far away; BadMotionFile
    where the motion is too short.
    """
    nearest, _ = planned_clip(SyntheticClip.model_validate(given), base, path, body)
    motion, film = nearest.motion, base.film
    if motion.n_frames != round(film.duration_s * motion.fps_hz):
        raise BadMotionFile(f"{path}: shorter than {film.duration_s:g} s")
    distance_m = round(roomy * _distance_m(nearest) + FOR_COMPANY_M * wanted.company, 2)
    if not _has_feet_on_the_floor(nearest, body):
        return "lying, climbing or jumping"
    if distance_m > (FARTHEST_IN_ROOM_M if wanted.place == "room" else FARTHEST_M):
        return NO_CAMERA
    given["programme"] = given["programme"] | {"distance_m": distance_m}
    moved = SyntheticClip.model_validate(given).programme
    return plan_clip(wanted.id, motion, moved, film, clip_rng(base.seed, wanted.id, "motion"))


def _sample_programme(kind: MotionClass, rng: np.random.Generator) -> Settings:
    """A camera of a class, held in the hand unless it is static."""
    view: Settings = {"kind": kind, "height_m": round(rng.uniform(1.1, 1.8), 2)}
    handheld_m, handheld_deg = round(rng.uniform(0.005, 0.015), 4), round(rng.uniform(0.15, 0.3), 3)
    held: Settings = {"handheld_m": handheld_m, "handheld_deg": handheld_deg}
    with_the_person, speed = rng.random() < 0.5, round(rng.uniform(0.25, 0.6), 2)
    speed_m_per_s = None if with_the_person else speed
    move = ("truck", "dolly")[int(rng.random() < 0.25)]
    match kind:
        case "static":
            return view
        case "small":
            drift_m, shake_deg = rng.uniform(0.015, 0.03), rng.uniform(0.25, 0.45)
            return view | {"drift_m": round(drift_m, 3), "shake_deg": round(shake_deg, 3)}
        case "panning":
            return view | held
        case "linear" | "linear_panning":
            return view | held | {"move": move, "speed_m_per_s": speed_m_per_s}
        case _:
            turn = ("counterclockwise", "clockwise")[int(rng.integers(2))]
            rate_deg_per_s = round(rng.uniform(12.0, 25.0), 1)
            return view | held | {"direction": turn, "rate_deg_per_s": rate_deg_per_s}


def _has_feet_on_the_floor(clip: Clip, body: BodyModel) -> bool:
    from gmrdata.values.skinning import motion_joints_m

    feet = [JOINT["left_foot"], JOINT["right_foot"]]
    lower_m = motion_joints_m(body, clip.motion)[:, feet, 2].min(axis=1)
    return bool((lower_m <= FLOOR_M).mean() >= FLOOR_SHARE)


def _distance_m(clip: Clip) -> float:
    """From the camera to the middle of the path, on the ground, at the middle of the clip [m]."""
    low_m, high_m = clip.motion.pelvis_m.min(axis=0), clip.motion.pelvis_m.max(axis=0)
    centres_m = camera_of(clip).centres_world_m
    away_m = centres_m[len(centres_m) // 2] - (low_m + high_m) / 2
    return float(np.linalg.norm(away_m[:2]))


def _in_view(clip: Clip, share: float) -> bool:
    inside = in_frame(camera_of(clip), person_box(clip.motion.pelvis_m))
    return float(inside.mean()) >= share


def is_beyond_doubt(clip: Clip, kind: MotionClass) -> bool:
    """Whether a clip's camera is of a class by whatever thresholds, within reason."""
    own, path, motion = MotionClassConfig(), camera_of(clip).world_from_cam, clip.motion
    _, figures = classify(path, motion.pelvis_m, motion.fps_hz, own)
    factors = (1.0, DOUBT, 1 / DOUBT)
    scaled = ({key: value * factor for key, value in own} for factor in factors)
    return {class_of(figures, MotionClassConfig(**one)) for one in scaled} == {kind}


def _has_room(scene: SceneConfig, planned: Clip, body: BodyModel) -> bool:
    """Whether all extras find a way, and the company is seen whole."""
    try:
        cast = make_cast(scene.extras, [planned], body, scene.seed)
    except BadRecipe:
        return False
    company = cast.walkers[: scene.extras.company]
    return all(_in_view(replace(planned, motion=one), COMPANY_IN_FRAME) for one in company)


SIZES_PX = {"small": (FILM.width_px, FILM.height_px), "full": (1080, 1920)}
"""Width and height by name: half of 3DPW's portrait camera, and the whole."""
MIN_SIDE_PX, MIN_FRAMES = 64, 60


def film_of(size: str, n_frames: int) -> Film:
    """The twins' film of `n_frames` at 30 fps, with 3DPW's horizontal field of view at any size:
    "small", "full", or width and height like 180x320 [px]; else BadRecipe."""
    width_px, height_px = SIZES_PX.get(size, (0, 0))
    if match := re.fullmatch(r"(\d{1,5})x(\d{1,5})", size):
        width_px, height_px = int(match[1]), int(match[2])
    if min(width_px, height_px) < MIN_SIDE_PX or max(width_px, height_px) > LARGEST_SIDE_PX:
        known = "small, full, or width x height in pixels, like 180x320"
        raise BadRecipe(f"--size {size}: give {known}, each {MIN_SIDE_PX} to {LARGEST_SIDE_PX}")
    if n_frames < MIN_FRAMES:
        why = "in less time the class of a camera's motion does not show"
        raise BadRecipe(f"--clip-frames {n_frames}: give {MIN_FRAMES} or more; {why}")
    assert FILM.fps_hz is not None
    size_px = {"width_px": width_px, "height_px": height_px}
    return FILM.model_copy(update=size_px | {"duration_s": n_frames / FILM.fps_hz})
