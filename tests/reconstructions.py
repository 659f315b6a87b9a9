"""Records of a reconstruction and its pseudo ground truth that every threshold lets pass."""

from typing import Any

import numpy as np

from gmrdata.cameras.files import NOT_SMOOTHED, CamerasQuality, Evidence
from gmrdata.cameras.lens.intrinsics import Intrinsics
from gmrdata.values.camera import CameraPath, Source
from gmrdata.values.camera_motion import MotionFigures
from gmrdata.world.judge import PseudoGtQuality
from gmrdata.world.level import LevelEstimate
from gmrdata.world.picture_fit import PictureFit
from gmrdata.world.recipe import CueEstimate, verdict_of

EVIDENCE = Evidence("full", "a pure rotation does not explain the matches", 8, 9, 4, 0.2, 0, 57, 60)


def good_quality(n_frames: int, **figures: Any) -> CamerasQuality:
    """Figures of T frames, some of them changed."""
    values: dict[str, Any] = {
        "geometry": "full",
        "mapper": "global",
        "evidence": EVIDENCE,
        "travel_set_aside": None,
        "frames": n_frames,
        "frames_with_camera": n_frames,
        "registered_share": 1.0,
        "mean_reprojection_px": 0.3,
        "median_reprojection_px": 0.2,
        "inliers_per_frame": (200,) * n_frames,
        "interpolated": (),
        "keyframes": (0, n_frames - 1),
        "cuts_after_frames": (),
        "featureless": (),
        "models": (),
        "resected_frames": 0,
        "focal_factor": None,
        "focal_sigma": None,
        "radial_k1": None,
        "radial_k1_sigma": None,
        "lens": None,
        "weakest_step": None,
        "second_share": None,
        "agreement": None,
        "smoothing": NOT_SMOOTHED,
        "points": 900,
        "median_track_length": 4.0,
        "largest_turn_deg": None,
        "worked_on_px": (640, 360),
    }
    return CamerasQuality(**(values | figures))


def quality_of_path(path: CameraPath, **figures: Any) -> CamerasQuality:
    """Figures of a camera that is known in some of its frames."""
    inliers = tuple(100 * int(known) for known in path.has_camera)
    share = {"registered_share": float(np.mean(path.has_camera))}
    return good_quality(path.n_frames, inliers_per_frame=inliers, **(share | figures))


def pseudo_gt_quality(cameras: CamerasQuality, scale: float | None) -> PseudoGtQuality:
    """The record of one accepted person, with all there is to be said of a scale."""
    cue = CueEstimate("planted_feet", scale or 1.0, 0.02, 9, 0.01, 0)
    return PseudoGtQuality(
        cameras=cameras,
        scale=scale,
        scale_sigma=None if scale is None else 0.02,
        scale_matters=scale is not None,
        scale_disagreement=None,
        scale_cues=(cue,),
        level=LevelEstimate(
            sigma_deg=1.0, cues=(), soles_above_m=0.0, floor_at_m=None, floor_sigma_m=0.0
        ),
        distance_sigmas=(0.02,),
        camera_motion="circular",
        camera_motion_figures=MotionFigures(9.0, 10.0, 37.0, 0.6, 0.001, 93.0, True, 5.0),
        people=(verdict_of("walk", True, (), [""] * cameras.frames),),
        picture_fits=(PictureFit(40, 1, 0.82, 0, 0.82, 0, ()),),
    )


def lens(source: Source, sigma: float, objections: tuple[str, ...] = ()) -> Intrinsics:
    """A focal length of 1088 px for 1280x720, from there and of that doubt."""
    return Intrinsics(
        source=source, width_px=1280, height_px=720, focal_px=1088.0, focal_y_px=1088.0,
        focal_sigma=sigma, centre_px=(640.0, 360.0),
        radial_k1=0.0, radial_k1_sigma=None, radial_k2=0.0,
        focal_observable=source != "prior", asked=None, asked_by_lines=None, starts=(),
        objections=objections, notes=(),
    )  # fmt: skip
