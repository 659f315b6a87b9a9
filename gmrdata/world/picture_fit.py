"""Whether bodies lie on the people in the pictures.

The outline of each projected body is compared with masks that were made without it.  Bodies of
another video lie beside the people, a stiff one covers them badly, and one that is late lies better
on the people of other frames.  Where landmarks of people were found too, limbs must lie on them: an
outline of somebody else in a like pose covers well enough.  Where they do, others in the mask say
nothing against the body.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from pydantic import NonNegativeInt
from pydantic.dataclasses import dataclass as part

from gmrdata.cameras.files import Distortion, bent_points
from gmrdata.people.following import load_tracks
from gmrdata.people.landmark_body import VISIBLE, SeenLandmarks, landmarks_about, legs_hidden
from gmrdata.people.landmark_network import LIMBS, TRUNK
from gmrdata.people.silhouette import silhouette
from gmrdata.read.frames import image_number, read_gray
from gmrdata.values.body import JOINT, BodyModel
from gmrdata.values.camera import CameraPath, Lens
from gmrdata.values.clip import Clip, camera_of
from gmrdata.values.records import PART, Figure
from gmrdata.values.skinning import motion_vertices_m
from gmrdata.world.recipe import VerdictConfig

LONGEST_PX = 320  # longer side of the small pictures in which outlines are compared
MOST_FRAMES = 40  # frames in which bodies are compared with people of other times, evenly spread
AT_ONCE = 64  # frames whose bodies are posed together
SAME_PLACE = 0.6  # overlap of two bodies' outlines from which they are on one person
FEWEST_FRAMES = 5  # with fewer that show both nothing is said
LAGS = np.arange(-30, 31)
"""Steps by which a body may be late."""
LAG_S = 1 / 30
"""Least time of such a step, so that they reach over a second at any rate [s]."""
LEGS = [JOINT[f"{side}_{part}"] for part in ("hip", "knee", "ankle", "foot")
        for side in ("left", "right")]  # fmt: skip
FEWEST_LIMBS = 4.0  # landmarks that count, by how well they are seen, which a comparison needs
SAME_TRUNK = 1.0  # distance of trunks, in the person's size, up to which they are of one
NEAREST_M = 0.1
MARGIN = 0.25  # of a body's box, around it, in which a mask counts: others may stand beside


@dataclass(frozen=True)
class PeopleMasks:
    """Masks of the people in the pictures that know nothing of the bodies."""

    masks_dir: Path  # <image stem>.png, 255 on people
    widened_px: int  # by which they are larger than the people are [px]
    boxed: bool  # filled boxes, not outlines
    followed_dir: Path | None = None  # of `follow_people`, whose landmarks the limbs are held to
    distortion: Distortion | None = None
    """Of the pictures, without which bodies stand before the camera; None where they were laid onto
    the pictures as a pinhole shows them."""

    def lens_of(self, camera: CameraPath) -> Lens:
        """Of the pictures that a clip's camera took."""
        bends = self.distortion
        return replace(camera.lens, radial=(0.0, 0.0) if bends is None else (bends.k1, bends.k2))


@part(frozen=True, config=PART)
class PictureFit:
    """How a body lies on the people in the pictures."""

    frames: NonNegativeInt
    """Those with a body that show somebody; all are compared."""
    off_frames: NonNegativeInt
    """Those of them in which it does not lie on anybody."""
    overlap: Figure
    """Median intersection over union of the body's outline and the mask around it."""
    late_frames: int
    """Frames by which the body is late: it lies best on the people of so many frames before; it is
    early where this is negative."""
    late_overlap: Figure
    """Median overlap then."""
    doubled_frames: NonNegativeInt
    """Compared ones in which the body of somebody before lies on the same place."""
    off_rows: tuple[int, ...]
    """Rows of the frames in which it does not lie on anybody."""


@dataclass(frozen=True, eq=False)
class SeenLimbs:
    """What landmarks of people show beside T frames of bodies; nothing where there are none."""

    landmarks: list[SeenLandmarks]  # everybody's, with the numbers of their images for times
    off: list[np.ndarray]
    """By body (T,): how far its limbs are from the nearest landmarks, in the person's size; NaN
    where nobody's trunk is about where the body's is."""
    legs_hidden: list[np.ndarray]  # by body (T,) bool: of whom these are has hidden legs


def seen_limbs(
    clips: Sequence[Clip], bodies: Sequence[BodyModel], people: PeopleMasks
) -> SeenLimbs:
    """Of bodies in the camera frame."""
    lens, folder = people.lens_of(camera_of(clips[0])), people.followed_dir
    landmarks = [
        SeenLandmarks(one.image_numbers, lens.rays(one.image_px), one.world_m, one.visibility)
        for one in ([] if folder is None else load_tracks(folder))
    ]
    limbs = [_limbs(clip, body, landmarks) for clip, body in zip(clips, bodies, strict=True)]
    return SeenLimbs(landmarks, [off for off, _ in limbs], [hidden for _, hidden in limbs])


def picture_fits(
    clips: Sequence[Clip],
    bodies: Sequence[BodyModel],
    people: PeopleMasks,
    config: VerdictConfig,
    limbs: SeenLimbs | None = None,
) -> list[PictureFit | None]:
    """By person, with bodies in the camera frame; None where too few frames show both.  A body lies
    on nobody where their overlap is less than `off_overlap` and no landmarks vouch for it, or its
    limbs are off by more than `off_limbs`.  `limbs` are of the same bodies."""
    limbs = limbs or seen_limbs(clips, bodies, people)
    masks = _Masks(people, camera_of(clips[0]))
    overlaps = [_Overlaps.empty(clip.valid) for clip in clips]
    known = np.flatnonzero(np.any([clip.valid for clip in clips], axis=0))
    shown = np.array([masks.of(int(clips[0].image_numbers[row])) is not None for row in known])
    both = known[shown] if len(known) else known
    lags = LAGS * max(1, round(LAG_S * clips[0].motion.fps_hz))
    compared_late = [_evenly(both[clip.valid[both]]) for clip in clips]
    for start in range(0, len(both), AT_ONCE):
        rows = both[start : start + AT_ONCE]
        outlines = [
            _outlines(clip, body, rows, hidden, masks)
            for clip, body, hidden in zip(clips, bodies, limbs.legs_hidden, strict=True)
        ]
        for person, (clip, own) in enumerate(zip(clips, outlines, strict=True)):
            others = [of for other, of in enumerate(outlines) if other != person]
            for row, outline in own.items():
                elsewhere = _elsewhere(row, outline, others)
                overlaps[person].now[row] = _at(clip, row, outline, elsewhere, masks)
                if overlaps[person].now[row] < config.off_overlap:
                    overlaps[person].covered[row] = _covered(clip, row, outline, masks)
                overlaps[person].doubled[row] = _doubled(row, outline, outlines[:person])
                if row in compared_late[person]:
                    late = [
                        _at(clip, row + lag, outline, elsewhere, masks) for lag in lags.tolist()
                    ]
                    overlaps[person].late.append(late)
    fits = []
    for person, (one, limbs_off) in enumerate(zip(overlaps, limbs.off, strict=True)):
        fit = _fit(one, lags, one.off(limbs_off, config))
        if fit and fit.late_frames:
            then, _ = _limbs(clips[person], bodies[person], limbs.landmarks, fit.late_frames)
            if not _are_late(limbs_off, then, clips[person].valid):
                fit = replace(fit, late_frames=0, late_overlap=fit.overlap)
        fits.append(fit)
    return fits


def _evenly(rows: np.ndarray) -> set[int]:
    """At most `MOST_FRAMES` of a person's rows: who is seen for a moment is compared as well."""
    some = np.linspace(0, len(rows) - 1, min(len(rows), MOST_FRAMES)).round().astype(int)
    return set(rows[some].tolist())


def _limbs(
    clip: Clip, body: BodyModel, landmarks: Sequence[SeenLandmarks], late: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """(T,) mean distance of limbs from the landmarks, so many frames before, of whom they lie
    nearest to, in the person's size in the picture, and whether both knees are hidden there; NaN
    and False where nobody's trunk is about where the body's is.  Landmarks have the numbers of
    their images for times."""
    motion = clip.motion
    placed_m = landmarks_about(motion.rotmats, body.rest_joints_m(motion.shape))
    placed_m = placed_m + motion.pelvis_m[:, None]
    rays = placed_m[..., :2] / placed_m[..., 2:].clip(NEAREST_M)
    nearest, hidden = np.full(len(rays), np.nan), np.zeros(len(rays), dtype=bool)
    rows = np.arange(max(0, late), len(rays) + min(0, late))
    numbers = clip.image_numbers[rows - late]
    for whole in landmarks:
        _, at, both = np.intersect1d(numbers, whole.times_s, return_indices=True)
        at, seen = rows[at], whole.take(both)
        apart = np.linalg.norm(rays[at] - seen.rays, axis=-1) / seen.sizes[:, None]
        shown = seen.visibility * (seen.visibility > VISIBLE)
        here = (apart[:, TRUNK].mean(axis=1) < SAME_TRUNK) & (shown[:, LIMBS].sum(1) > FEWEST_LIMBS)
        off = (shown * apart)[:, LIMBS].sum(1) / np.maximum(shown[:, LIMBS].sum(1), FEWEST_LIMBS)
        nearer = here & ~(off >= nearest[at])
        nearest[at[nearer]] = off[nearer]
        hidden[at[nearer]] = legs_hidden(seen.visibility[nearer])
    return nearest, hidden


def _are_late(now: np.ndarray, then: np.ndarray, valid: np.ndarray) -> bool:
    """Whether limbs, too, lie nearer to people's landmarks of another time: beside who stands
    still, others who come and go in the mask make any other time look better.  So it is where
    landmarks don't tell."""
    known = valid & np.isfinite(now) & np.isfinite(then)
    if known.sum() < FEWEST_FRAMES:
        return True
    return bool(np.median(then[known]) < np.median(now[known]))


@dataclass(frozen=True, eq=False)
class _Outline:
    """(h, w) bool: where a body is in the picture."""

    whole: np.ndarray
    shown: np.ndarray
    """What must be on somebody: the same, or without the legs of who is hidden below the hips."""


@dataclass(frozen=True, eq=False)
class _Overlaps:
    """Of one person's outline with the masks; NaN where nothing was compared."""

    now: np.ndarray  # (T,)
    covered: np.ndarray  # (T,) share of an outline of too little overlap that is in the mask
    doubled: np.ndarray  # (T,) bool: another body lies on the same place
    late: list[list[float]]  # of some frames, by lag

    @classmethod
    def empty(cls, valid: np.ndarray) -> "_Overlaps":
        now, covered = np.full((2, len(valid)), np.nan)
        return cls(now, covered, np.zeros(len(valid), dtype=bool), [])

    def off(self, limbs_off: np.ndarray, config: VerdictConfig) -> np.ndarray:
        """(T,) bool: the outline, or limbs of such a distance from landmarks, don't lie on the
        person.  Limbs that do vouch for a body that the mask covers: the rest of the mask is others
        then."""
        vouched = (limbs_off <= config.off_limbs) & (self.covered >= config.off_overlap)
        beside = (self.now < config.off_overlap) & ~vouched
        return np.isfinite(self.now) & (beside | (limbs_off > config.off_limbs))


def _elsewhere(row: int, outline: _Outline, others: Sequence[dict[int, _Outline]]) -> np.ndarray:
    """(h, w) bool: what only others cover."""
    covered = np.zeros_like(outline.whole)
    for other in others:
        if row in other:
            covered |= other[row].whole & ~outline.whole
    return covered


def _doubled(row: int, outline: _Outline, before: Sequence[dict[int, _Outline]]) -> bool:
    """Whether the body of somebody before, who is seen in as many frames, lies where this does."""
    there = [of[row].whole for of in before if row in of]
    own = outline.whole
    return any(
        np.count_nonzero(its & own) > SAME_PLACE * np.count_nonzero(its | own) for its in there
    )


def _at(clip: Clip, row: int, outline: _Outline, elsewhere: np.ndarray, masks: "_Masks") -> float:
    """Overlap of an outline with the people of a row's picture; NaN where it shows none."""
    if not 0 <= row < len(clip.image_numbers):
        return np.nan
    mask = masks.of(int(clip.image_numbers[row]))
    return np.nan if mask is None else _overlap(outline, mask & ~elsewhere)


def _covered(clip: Clip, row: int, outline: _Outline, masks: "_Masks") -> float:
    mask = masks.of(int(clip.image_numbers[row]))
    n = np.count_nonzero(outline.shown)
    return np.count_nonzero(outline.shown & mask) / n if n and mask is not None else 0.0


class _Masks:
    """Small masks by the number of their image."""

    def __init__(self, people: PeopleMasks, camera: CameraPath) -> None:
        # Eight pixels a byte: all frames of a video are kept.
        self._people, self._cache = people, dict[int, np.ndarray | None]()
        self._size_px = camera.width_px, camera.height_px
        self.shrink = min(1.0, LONGEST_PX / max(self._size_px))

    @cached_property
    def _paths(self) -> dict[int, Path]:
        return {image_number(path): path for path in sorted(self._people.masks_dir.glob("*.png"))}

    @property
    def small_px(self) -> tuple[int, int]:
        """(width, height)."""
        width, height = (max(1, round(self.shrink * side)) for side in self._size_px)
        return width, height

    @property
    def widened_px(self) -> int:
        return round(self.shrink * self._people.widened_px)

    def of(self, number: int) -> np.ndarray | None:
        """(h, w) bool; None where there is no mask, or nobody in it."""
        if number not in self._cache:
            mask = self._read(number)
            self._cache[number] = None if mask is None else np.packbits(mask, axis=1)
        packed = self._cache[number]
        if packed is None:
            return None
        return np.unpackbits(packed, axis=1, count=self.small_px[0]).astype(bool)

    def _read(self, number: int) -> np.ndarray | None:
        import cv2

        if number not in self._paths:
            return None
        mask = read_gray(self._paths[number], self._size_px)
        small = cv2.resize(mask, self.small_px, interpolation=cv2.INTER_AREA) > 127
        return np.asarray(small) if small.any() else None

    def outline(
        self, vertices_cam_m: np.ndarray, faces: np.ndarray, k_px: np.ndarray
    ) -> np.ndarray:
        """(h, w) bool: a body as such a mask would show it."""
        small_k_px = np.diag([self.shrink, self.shrink, 1.0]) @ k_px
        bent_m = bent_points(vertices_cam_m, self._people.distortion)
        shown = silhouette(bent_m, faces, small_k_px, self.small_px, self.widened_px) > 0
        if self._people.boxed and shown.any():
            shown[_box(shown)] = True
        return shown


def _box(shown: np.ndarray, margin: float = 0.0) -> tuple[slice, slice]:
    """Rows and columns of what is shown, (h, w) bool, with a margin as a share of their number."""
    box = []
    for axis in (1, 0):
        at = np.flatnonzero(shown.any(axis=axis))
        reach = round(margin * (at[-1] + 1 - at[0]))
        box.append(slice(max(0, at[0] - reach), at[-1] + 1 + reach))
    return box[0], box[1]


def _outlines(
    clip: Clip, body: BodyModel, rows: np.ndarray, hidden: np.ndarray, masks: _Masks
) -> dict[int, _Outline]:
    """Outlines of a person in those of the rows in which the body is known."""
    own = rows[clip.valid[rows]]
    if not len(own):
        return {}
    posed_m = motion_vertices_m(body, clip.motion, rows=own)
    intrinsics_px = camera_of(clip).intrinsics_px
    of_legs = body.skin_weights[:, LEGS].sum(axis=1) > VISIBLE
    above = body.faces[~of_legs[body.faces].all(axis=1)]
    outlines = {}
    for row, vertices_m in zip(own.tolist(), posed_m, strict=True):
        whole = masks.outline(vertices_m, body.faces, intrinsics_px)
        shown = masks.outline(vertices_m, above, intrinsics_px) if hidden[row] else whole
        outlines[row] = _Outline(whole, shown)
    return outlines


def _fit(found: _Overlaps, lags: np.ndarray, off: np.ndarray) -> PictureFit | None:
    compared = np.isfinite(found.now)
    if compared.sum() < FEWEST_FRAMES or len(found.late) < FEWEST_FRAMES:
        return None
    overlaps = np.array(found.late).T
    now = overlaps[lags == 0][0]
    shown = np.isfinite(overlaps).sum(axis=1)
    # Only frames that are compared at both times tell which is better.
    medians = [
        (float(np.median(at[both])), float(np.median(now[both])))
        if (both := np.isfinite(at)).sum() >= max(FEWEST_FRAMES, shown.max() / 2)
        else (0.0, 1.0)
        for at in overlaps
    ]
    best = max(range(len(lags)), key=lambda number: medians[number][0] - medians[number][1])
    if medians[best][0] <= medians[best][1]:
        best = int(np.flatnonzero(lags == 0)[0])
    return PictureFit(
        frames=int(compared.sum()),
        off_frames=int(off.sum()),
        overlap=float(np.median(found.now[compared])),
        late_frames=int(-lags[best]),
        late_overlap=float(np.median(found.now[compared])) + medians[best][0] - medians[best][1],
        doubled_frames=int(found.doubled.sum()),
        off_rows=tuple(np.flatnonzero(off).tolist()),
    )


def _overlap(outline: _Outline, mask: np.ndarray) -> float:
    """Intersection over union within the body's surroundings; 0 for one outside of the picture."""
    if not outline.shown.any():
        return 0.0
    box = _box(outline.whole, MARGIN)
    both = np.count_nonzero(outline.whole & mask)
    return both / np.count_nonzero(outline.shown[box] | mask[box])
