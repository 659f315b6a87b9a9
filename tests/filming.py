"""A small world to film: a textured room with boxes, drawn by casting one ray per pixel."""

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmrdata.cameras.files import Distortion, load_cameras, load_points
from gmrdata.cameras.frames import Frames
from gmrdata.cameras.match.tracks import errors_px, load_tracks, mean_over_points
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.cameras.reconstruct import reconstruct
from gmrdata.read.frames import read_frames
from gmrdata.values import transforms
from gmrdata.values.camera import Lens, intrinsics_from_fov
from gmrdata.values.frame_set import FrameSet
from gmrdata.values.transforms import fit_similarity

WIDTH_PX, HEIGHT_PX = 320, 180
INTRINSICS_PX = intrinsics_from_fov(65.0, WIDTH_PX, HEIGHT_PX)
CAMERAS_ALONE = (
    "--masks", "none", "--focal", str(float(INTRINSICS_PX[0, 0])), "--no-check-lens",
    "--poses", "none",
)  # fmt: skip
"""Flags of `gmrdata video` for cameras of what is drawn here."""
TEXELS = 512
TEXELS_PER_M = 64.0


@dataclass(frozen=True, eq=False)
class Filmed:
    """A folder of frames and masks, and the cameras that took them."""

    images_dir: Path
    masks_dir: Path
    intrinsics_px: np.ndarray
    world_from_cam: np.ndarray

    @property
    def frames(self) -> Frames:
        """What the camera stage works on."""
        images = list(self.taken().paths)
        return Frames(images, self.masks_dir, self.intrinsics_px, (WIDTH_PX, HEIGHT_PX))

    @property
    def lens(self) -> Lens:
        return Lens.of_matrix(self.intrinsics_px, (WIDTH_PX, HEIGHT_PX))

    def taken(self, left_out: Collection[int] = ()) -> FrameSet:
        return read_frames(self.images_dir, left_out)

    def solved(self, out_dir: Path, config: SfmConfig, left_out: Collection[int] = ()) -> Path:
        """The camera stage's folder of these frames and masks."""
        return reconstruct(self.taken(left_out), self.masks_dir, self.lens, out_dir, config)

    def centre_errors_m(self, found: np.ndarray) -> np.ndarray:
        """Distances of camera centres (T, 3) from the true ones after the best similarity."""
        true = self.world_from_cam[:, :3, 3]
        return np.linalg.norm(fit_similarity(true, found, scale=True).apply(found) - true, axis=1)


def write_pictures(folder: Path, pictures: Iterable[np.ndarray]) -> list[Path]:
    """Pictures as 00000.png, 00001.png and so on."""
    folder.mkdir(parents=True)
    paths = []
    for row, picture in enumerate(pictures):
        paths.append(folder / f"{row:05d}.png")
        cv2.imwrite(str(paths[-1]), picture)
    return paths


def coarse_noise(n: int) -> list[np.ndarray]:
    """Unrelated pictures (120, 160) uint8 whose features all lie in the first octave."""
    coarse = np.random.default_rng(0).integers(0, 255, (n, 30, 40)).astype(np.uint8)
    return [cv2.resize(one, (160, 120), interpolation=cv2.INTER_CUBIC) for one in coarse]


def look_at(centre_m: np.ndarray, target_m: np.ndarray) -> np.ndarray:
    """world_from_cam (4, 4) of a level camera."""
    forward = (target_m - centre_m) / np.linalg.norm(target_m - centre_m)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    camera = np.eye(4)
    camera[:3] = np.stack([right, np.cross(forward, right), forward, centre_m], axis=1)
    return camera


def _textures(rng: np.random.Generator) -> list[np.ndarray]:
    textures = []
    for _ in range(12):
        image = np.zeros((TEXELS, TEXELS))
        for cells in (16, 64, 160):
            noise = rng.uniform(0, 1, (cells, cells))
            image += cv2.resize(noise, (TEXELS, TEXELS), interpolation=cv2.INTER_CUBIC) / 3
        textures.append(np.clip(255 * image, 0, 255).astype(np.uint8))
    return textures


ROOM = (np.array([-4.0, -4.0, 0.0]), np.array([4.0, 4.0, 3.0]))
BOXES = (
    (np.array([-2.6, 2.0, 0.0]), np.array([-1.7, 2.8, 1.6])),
    (np.array([1.2, 1.4, 0.0]), np.array([2.2, 2.3, 1.1])),
    (np.array([-0.6, 2.6, 0.0]), np.array([0.3, 3.3, 2.0])),
)


def draw(
    world_from_cam: np.ndarray, textures: list[np.ndarray], person_m: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """Image and mask (H, W) uint8 of the room; a textured box at `person_m` walks through it."""
    u, v = np.meshgrid(np.arange(WIDTH_PX) + 0.5, np.arange(HEIGHT_PX) + 0.5)
    pixels = np.stack([u, v, np.ones_like(u)], axis=-1)
    rays = pixels @ np.linalg.inv(INTRINSICS_PX).T @ world_from_cam[:3, :3].T
    # Axes come first from here on: the least of three whole pictures is quickly found.
    rays = np.ascontiguousarray(np.moveaxis(rays, -1, 0))
    rays = np.where(np.abs(rays) < 1e-9, 1e-9, rays)
    centre = world_from_cam[:3, 3]
    boxes = [ROOM, *BOXES]
    if person_m is not None:
        size_m = np.array([0.5, 0.5, 1.7])
        boxes.append((person_m - size_m * [0.5, 0.5, 0.0], person_m + size_m * [0.5, 0.5, 1.0]))
    nearest = np.full(u.shape, np.inf)
    image, mask = np.zeros(u.shape, np.uint8), np.zeros(u.shape, np.uint8)
    for b, (low, high) in enumerate(boxes):
        ends = [(corner - centre)[:, None, None] / rays for corner in (low, high)]
        enter, leave = np.minimum(*ends), np.maximum(*ends)
        # The room is seen from inside, everything else from outside.
        hit_depth = leave.min(axis=0) if b == 0 else enter.max(axis=0)
        side = leave.argmin(axis=0) if b == 0 else enter.argmax(axis=0)
        hit = (enter.max(axis=0) < leave.min(axis=0)) & (hit_depth > 0) & (hit_depth < nearest)
        nearest[hit] = hit_depth[hit]
        for axis in range(3):
            seen = hit & (side == axis)
            point = centre + rays[:, seen].T * hit_depth[seen][:, None]
            point = point - (low if b == len(BOXES) + 1 else 0.0)
            at = (np.delete(point, axis, axis=-1) * TEXELS_PER_M + 8 * TEXELS).astype(np.float32)
            texture = textures[(3 * b + axis) % len(textures)]
            image[seen] = _shade(texture, np.mod(at, TEXELS))
        mask = np.where(hit, 255 if b == len(BOXES) + 1 else 0, mask).astype(np.uint8)
    return image, mask


def _shade(texture: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(N,) grey values at (N, 2) columns and rows."""
    if not len(at):
        return np.zeros(0, np.uint8)
    # (N, 1): OpenCV 5 takes (N,) as one row, OpenCV 4 as one column.
    column, row = at.T[:, :, None]
    shade = cv2.remap(texture, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    return np.asarray(shade)[:, 0]


def film_cameras(folder: Path, cameras: np.ndarray, person_m: np.ndarray | None) -> Filmed:
    """Film the room through cameras (T, 4, 4), with a person at (T, 3) on its floor, or empty."""
    rng = np.random.default_rng(5)
    textures = _textures(rng)
    (folder / "frames").mkdir(parents=True)
    (folder / "masks").mkdir()
    for i, camera in enumerate(cameras):
        image, mask = draw(camera, textures, None if person_m is None else person_m[i])
        noisy = np.clip(image + rng.normal(0, 1.5, image.shape), 0, 255).astype(np.uint8)
        cv2.imwrite(str(folder / "frames" / f"{i:05d}.jpg"), noisy, [cv2.IMWRITE_JPEG_QUALITY, 95])
        cv2.imwrite(str(folder / "masks" / f"{i:05d}.png"), mask)
    return Filmed(folder / "frames", folder / "masks", INTRINSICS_PX, cameras)


def motion_errors(found: np.ndarray, true: np.ndarray, step: int) -> tuple[float, float]:
    """Root mean square errors [degrees, unit] of the motions over so many frames."""
    moves = [transforms.invert(cameras[:-step]) @ cameras[step:] for cameras in (found, true)]
    apart = np.swapaxes(moves[0][:, :3, :3], 1, 2) @ moves[1][:, :3, :3]
    degrees = np.rad2deg(Rotation.from_matrix(apart).magnitude())
    lengths = np.linalg.norm(moves[0][:, :3, 3] - moves[1][:, :3, 3], axis=1)
    return float(np.sqrt(np.mean(degrees**2))), float(np.sqrt(np.mean(lengths**2)))


def turn_errors_deg(found: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Angles between the orientations of cameras (T, 4, 4), or rotations (T, 3, 3), after the best
    common turn of the found world; two of the same world differ by at most twice as much."""
    found, true = found[:, :3, :3], true[:, :3, :3]
    u, _, vt = np.linalg.svd((true @ np.swapaxes(found, 1, 2)).sum(axis=0))
    aligned = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt @ found
    chord = np.linalg.norm(aligned - true, axis=(1, 2))
    return np.rad2deg(2 * np.arcsin(np.clip(chord / np.sqrt(8), 0, 1)))


def tracked_error_px(sfm_dir: Path, lens: Distortion | None) -> float:
    """The mean error of a reconstruction's cameras, as its tracks give it again."""
    tracks, points = load_tracks(sfm_dir).of_adjusted(), load_points(sfm_dir)
    path = load_cameras(sfm_dir).path
    found_px = errors_px(tracks, points, path.world_from_cam, path.intrinsics_px, lens)
    return mean_over_points(found_px, tracks.points)


def solve_keyframes_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep the first model of the keyframes for all solutions of a test, which film the same."""
    from gmrdata.cameras import reconstruct as geometry
    from gmrdata.cameras.check import agreement

    of_geometry = (
        "match_frames", "match_behind_masks", "adjust_keypoints", "map_frames",
        "with_frames_between",
    )  # fmt: skip
    for module, names in ((geometry, of_geometry), (agreement, ("map_again", "map_otherwise"))):
        for name in names:
            monkeypatch.setattr(module, name, _once(getattr(module, name)))


def _once(function: Callable[..., Any]) -> Callable[..., Any]:
    answers: list[Any] = []

    def first(*args: Any) -> Any:
        if not answers:
            answers.append(function(*args))
        return answers[0]

    return first


@pytest.fixture(scope="session")
def film(tmp_path_factory) -> Callable[..., Filmed]:
    """Film a person who walks through the room: "pan", "dolly" or "arc", so many frames.

    Without a person, the same cameras film the room alone.
    """

    def make(kind: str, n_frames: int, person: bool = True) -> Filmed:
        along = np.linspace(0, 1, n_frames)
        person_m = np.stack([-1.2 + 2.4 * along, 0 * along + 0.4, 0 * along], axis=1)
        centres = {
            "pan": np.stack([0 * along, 0 * along - 3.0, 0 * along + 1.5], axis=1),
            "dolly": np.stack([-1.0 + 2.0 * along, 0 * along - 3.0, 0 * along + 1.5], axis=1),
            "arc": 3.2 * np.stack([np.sin(along), -np.cos(along), 0 * along], axis=1)
            + [0.0, 0.4, 1.5],
        }[kind]
        targets = person_m + np.array([0.0, 0.0, 1.0])
        cameras = np.array([look_at(c, t) for c, t in zip(centres, targets, strict=True)])
        return film_cameras(tmp_path_factory.mktemp(kind), cameras, person_m if person else None)

    return make


@pytest.fixture(scope="session")
def pan(film) -> Filmed:
    """A camera on a tripod that follows the person."""
    return film("pan", 12)


@pytest.fixture(scope="session")
def dolly(film) -> Filmed:
    """A camera on rails beside the person."""
    return film("dolly", 12)
