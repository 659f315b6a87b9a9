"""People in the world, as `gmrdata video` puts them there, against the truth."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from people.before_camera import drawn_shirt, within
from people.real import TWELVE, Dance, View
from poses.score import aligned_mm, wa_mpjpe_mm

from gmrdata.fusion.record import load_sigma, sigma_file
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip, camera_of, load_clip
from gmrdata.values.people import BODIES, FUSED, PSEUDO_GT, person_file
from gmrdata.values.skinning import motion_joints_m
from gmrdata.values.transforms import angles_deg, apply, fit_similarity, invert, mean_rotation
from gmrdata.world.compose import motion_in_camera
from gmrdata.world.judge import PseudoGtQuality, load_record
from gmrdata.world.level import level_from_world

FORWARD, UP = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
TREADMILL_M = 0.24
"""How high the man's floor is above that of the room, where z = 0 is if a woman behind him is in
the world, too: by her feet in two calibrated views, as the landmark network sees them."""


@dataclass(frozen=True)
class WorldRow:
    """One clip's person in the world; a figure that nothing true is there for is None."""

    clip: str
    accepted: bool
    frames: int
    wa_mm: float | None
    """WA-MPJPE over the 12 joints of limbs."""
    scale_off: float | None
    """Of the cameras' path, as a share."""
    level_deg: float
    said_deg: float
    """One standard error of the level."""
    floor_m: float | None
    """Height of the true floor in the world that was found."""
    place_mm: float
    """Of the hips' middle, or the shirt, after one rigid transform, root mean square."""
    within: tuple[float, float]
    """Shares of errors, axis by axis, within one and two standard errors, after a heading and a
    place on the floor: up and the floor are part of what is said."""
    within_before_camera: tuple[float, float]
    """The same before the camera, with no transform."""


def man_row(view: View, solved_dir: Path, body: BodyModel) -> WorldRow:
    """The man in one view's world."""
    truth_m = view.true_m
    hips_m = truth_m[:, 6:8].mean(axis=1)
    quality, number = load_record(solved_dir / PSEUDO_GT), the_man(view, solved_dir, body)
    clip = load_clip(solved_dir / FUSED / person_file(number))
    joints_m, found_m = limbs_and_hips_m(clip, body)
    world_from_cam = camera_of(clip).world_from_cam
    before_m = apply(invert(world_from_cam), found_m[:, None])[:, 0]
    true_m = apply(view.level_from_cam, hips_m)
    # Of him alone a remark says that his own feet err: z = 0 is where they stand, all the same.
    remark = None if quality.level is None else quality.level.remark
    if remark is not None and len(quality.people) > 1:
        true_m = true_m + np.array([0.0, 0.0, TREADMILL_M])
    sigmas = load_sigma(solved_dir / FUSED / sigma_file(number))
    return WorldRow(
        clip=view.name,
        wa_mm=wa_mpjpe_mm(joints_m, truth_m),
        scale_off=None,
        floor_m=None,
        **level_figures(world_from_cam[0, :3, :3] @ view.up, quality, number),
        **place_figures(found_m, true_m, sigmas),
        within_before_camera=within((before_m - hips_m) / sigmas["camera_sigma_m"]),
    )


@dataclass(frozen=True)
class BesideRow:
    """The man with somebody before him; joints are the 12 of limbs, before the camera."""

    view: str
    people: int
    accepted: int
    kept_frames: int
    """Of the man."""
    pa_mm: float
    """In these frames."""
    worst_pa_mm: float
    level_deg: float
    said_deg: float


def beside_row(view: View, solved_dir: Path, body: BodyModel) -> BesideRow:
    """The man in a view that shows somebody else, too."""
    quality, number = load_record(solved_dir / PSEUDO_GT), the_man(view, solved_dir, body)
    clip, kept = load_clip(solved_dir / BODIES / person_file(number)), quality.people[number].kept
    found_m, true_m = limbs_and_hips_m(clip, body)[0][kept], view.true_m[clip.image_numbers[kept]]
    pa_mm = aligned_mm(found_m, true_m)
    world_from_cam = camera_of(load_clip(solved_dir / FUSED / person_file(number))).world_from_cam
    level = level_figures(world_from_cam[0, :3, :3] @ view.up, quality, number)
    return BesideRow(
        view.name,
        len(quality.people),
        sum(person.accepted for person in quality.people),
        len(pa_mm),
        float(pa_mm.mean()),
        float(pa_mm.max()),
        level["level_deg"],
        level["said_deg"],
    )


def the_man(view: View, solved_dir: Path, body: BodyModel) -> int:
    """The number of the person whose hips are nearest to the man's."""
    hips_m = view.true_m[:, 6:8].mean(axis=1)

    def apart(number: int) -> float:
        found_m = limbs_and_hips_m(load_clip(solved_dir / BODIES / person_file(number)), body)[1]
        off = found_m[:, :2] / found_m[:, 2:] - hips_m[:, :2] / hips_m[:, 2:]
        return float(np.median(np.linalg.norm(off, axis=1)))

    return min(range(len(load_record(solved_dir / PSEUDO_GT).people)), key=apart)


def limbs_and_hips_m(clip: Clip, body: BodyModel) -> tuple[np.ndarray, np.ndarray]:
    """The 12 joints (T, 12, 3), and the middle of the hips (T, 3)."""
    joints_m = motion_joints_m(body, clip.motion)[:, TWELVE]
    return joints_m, joints_m[:, 6:8].mean(axis=1)


def dancer_row(dance: Dance, solved_dir: Path, body: BodyModel, name: str) -> WorldRow:
    """The dancer's shirt, and her cameras, in her world."""
    quality = load_record(solved_dir / PSEUDO_GT)
    clip = load_clip(solved_dir / FUSED / person_file(0))
    camera = camera_of(clip)
    found, true = camera.world_from_cam, dance.world_from_cam[clip.image_numbers]
    cameras_m = found[:, :3, 3], true[:, :3, 3]
    true_from_found = fit_similarity(*reversed(cameras_m), scale=True)
    turn = mean_rotation(true[:, :3, :3] @ found[:, :3, :3].swapaxes(1, 2))
    # The floor below the shirt, in the world that was found.
    shirt_m = dance.shirt_m[clip.image_numbers]
    below_m = shirt_m - np.outer(shirt_m @ dance.up - dance.floor_m, dance.up)
    floor_m = (
        (below_m - true_from_found.translation_m) @ true_from_found.rotmat / true_from_found.scale
    )
    seen = motion_in_camera(clip.motion, found)
    own_lens = replace(dance, lens=camera.lens)
    _, places_m = drawn_shirt(seen, clip.image_numbers, own_lens, body)
    row_of = {int(number): row for row, number in enumerate(clip.image_numbers)}
    rows = np.array([row_of[int(number)] for number in dance.rows])
    known = np.isfinite(places_m).all(axis=1) & np.isfinite(shirt_m[rows]).all(axis=1)
    places_m, rows = places_m[known], rows[known]
    world_m = apply(found[rows], places_m[:, None])[:, 0]
    level = level_from_world(dance.up, dance.floor_m, shirt_m[rows[0]], FORWARD)
    before_m = places_m - apply(invert(true[rows]), shirt_m[rows][:, None])[:, 0]
    sigmas = {key: of[rows] for key, of in load_sigma(solved_dir / FUSED / sigma_file(0)).items()}
    return WorldRow(
        clip=name,
        wa_mm=None,
        scale_off=float(1 / true_from_found.scale - 1),
        floor_m=float(np.nanmedian(floor_m[:, 2])),
        **level_figures(turn.T @ dance.up, quality, 0),
        **place_figures(world_m, apply(level, shirt_m[rows]), sigmas),
        within_before_camera=within(before_m / sigmas["camera_sigma_m"]),
    )


def level_figures(up: np.ndarray, quality: PseudoGtQuality, number: int) -> dict[str, Any]:
    """Of the true up in a world that was found, and of a person in it, as a row's fields."""
    assert quality.level is not None
    return {
        "accepted": quality.people[number].accepted,
        "frames": quality.people[number].frames,
        "level_deg": float(angles_deg(up, UP)),
        "said_deg": quality.level.sigma_deg,
    }


def place_figures(
    found_m: np.ndarray, true_m: np.ndarray, sigmas: dict[str, np.ndarray]
) -> dict[str, Any]:
    """Of places in worlds with z up and the floor at z = 0, as a row's fields have them."""
    off_m = found_m - fit_similarity(found_m, true_m, scale=False).apply(true_m)
    return {
        "place_mm": float(1000 * np.sqrt((off_m**2).sum(axis=1).mean())),
        "within": within(_on_the_floor_m(found_m, true_m) / sigmas["place_sigma_m"]),
    }


def _on_the_floor_m(found_m: np.ndarray, true_m: np.ndarray) -> np.ndarray:
    """(T, 3) what is left after the best heading and place on the floor."""
    found, true = (points[:, :2] - points[:, :2].mean(axis=0) for points in (found_m, true_m))
    turn = np.angle(((found[:, 0] + 1j * found[:, 1]) * (true[:, 0] - 1j * true[:, 1])).sum())
    turned = true @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    return np.column_stack([found - turned, found_m[:, 2] - true_m[:, 2]])
