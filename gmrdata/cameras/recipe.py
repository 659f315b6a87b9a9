"""The recipe of structure from motion, and the thresholds that its cameras must keep to."""

from pydantic import Field

from gmrdata.values import limits
from gmrdata.values.records import Config


class SfmConfig(Config):
    """Cameras from frames: features, pairs, verification, choice of geometry, refinement."""

    max_image_size_px: int = Field(default=1280, ge=64, le=limits.LARGEST_SIDE_PX)
    """Longer side above which frames are reduced before anything is sought in them; all pixels of
    this recipe and of the record are then those of the reduced frames [px]."""
    keyframe_step: float = Field(default=0.04, ge=0, le=0.5)
    """How far the background moves from one keyframe to the next, as a share of the frame's longer
    side; 0: every frame is a keyframe."""
    keyframe_parallax: float = Field(default=0.015, ge=0, le=0.5)
    """How far the nearest fifth of the background moves beside what a turn of the camera explains,
    as a share of the same."""
    keyframe_gap: int = Field(default=15, ge=1, le=limits.MOST_FRAMES)
    """Frames from one keyframe to the next at most."""
    min_keyframes: int = Field(default=12, ge=2, le=limits.MOST_FRAMES)
    """Keyframes at least, evenly spread where the motion asks for fewer: mappers need pairs."""
    keyframe_image_size_px: int = Field(default=640, ge=64, le=limits.LARGEST_SIDE_PX)
    """Longer side of the reduced frames on which keyframes are chosen [px]."""
    followed_points: int = Field(default=500, ge=20, le=100_000)
    """Points of a keyframe that are followed into the frames between, at most."""
    max_features: int = Field(default=2000, ge=100, le=100_000)
    """Places of SIFT features per frame at most; the largest are kept."""
    max_orientations: int = Field(default=2, ge=1, le=4)
    """Features that one place may have, of as many directions.  With 1 the camera must not roll by
    much from one keyframe to the next, and mapping takes two thirds of the time."""
    first_octave: int | None = Field(default=None, ge=-1, le=2)
    """First SIFT octave: -1 doubles the image (slower, more features), 0 takes it as it is; null
    doubles images of fewer than a quarter of a megapixel."""
    overlap: int = Field(default=8, ge=1, le=1000)
    """Each frame is paired with those 1, 2, 4, ... later: so many pairs per frame."""
    min_pair_inliers: int = Field(default=15, ge=8)
    """Matches that a pair of frames must share after geometric verification."""
    verification_error_px: float = Field(default=2.0, gt=0)
    """Distance from the epipolar line (or homography) up to which a match is an inlier [px]."""
    rotation_only_median_px: float = Field(default=1.0, gt=0)
    """Largest median residual at which a pure rotation explains the matches [px]."""
    rotation_only_wide_median_px: float = Field(default=1.5, gt=0)
    """Largest median residual of the worst tenth of the pairs for a pure rotation [px]."""
    rotation_only_inlier_px: float = Field(default=2.0, gt=0)
    """Residual up to which a match agrees with a pure rotation [px]."""
    rotation_only_share: float = Field(default=0.85, gt=0, le=1)
    """Smallest share of verified matches that must agree with a pure rotation."""
    small_travel_share: float = Field(default=0.1, ge=0)
    """A camera whose places are further apart than this share of the background's distance
    travels; of one that doesn't, a pure rotation is taken if the model is bent."""
    small_travel_median_px: float = Field(default=1.5, gt=0)
    """Largest median residual of a pure rotation for that [px]."""
    static_px: float = Field(default=0.3, ge=0)
    """A camera that only turns, and moves the middle of its image by less than this, is static
    [px]."""
    min_frames_registered: int = Field(default=3, ge=2)
    """A reconstruction with fewer cameras counts as none."""
    min_frame_points: int = Field(default=15, ge=4)
    """A frame that sees fewer background points has no camera, for six degrees of freedom."""
    acceleration_deg: float = Field(default=0.002, gt=0)
    """Least standard deviation of the change in the camera's turn from one frame to the next, per
    axis, of the prior that refines all frames together [degrees/frame^2]; a path that keeps to more
    is allowed that.  The default is 1.8 degrees/s^2 at 30 frames/s, the unrest of a good tripod
    head; with a camera's noise of 0.004 degrees it halves what is faster than 0.115 cycles/frame,
    3.4 Hz, so that even a hand's 0.5-2 Hz would pass, which itself is far above that value.  A
    large value (1) smooths nothing."""
    acceleration_share: float = Field(default=4e-5, gt=0)
    """The same for its place, as a share of the background's median distance, since metres are not
    known yet [1/frame^2]: 0.14 m/s^2 for a background 4 m away, at 30 frames/s."""
    max_gap_frames: int = Field(default=5, ge=0)
    """Frames without a camera between two with one get an interpolated camera if they are not more
    than this, left-out images among them; 0: none is interpolated."""
    max_reprojection_px: float = Field(default=2.0, gt=0)
    """Observations with a larger error are dropped before the last bundle adjustment [px]."""
    threads: int | None = Field(default=None, ge=1, le=limits.MOST_WORKERS)
    """Threads for finding features, whose number changes nothing in them; None for all cores, or a
    worker process's share of them.  All else of COLMAP uses one, so that results repeat."""
    seed: int = Field(default=0, ge=0, le=2**31 - 1)
    """Seed of every random choice."""


class CamerasVerdictConfig(Config):
    """What cameras must keep to, up to scale and without a body."""

    min_registered_share: float = Field(default=0.7, ge=0, le=1)
    """Share of the images that have a camera."""
    max_reprojection_px: float = Field(default=1.0, gt=0)
    """Mean reprojection error of the background [px]."""
    max_loose_share: float = Field(default=0.006, gt=0)
    """What the weakest step leaves open of the cameras' places, as a share of their way.  Measured:
    up to 0.0015 for right cameras of real clips, the most where the middle third is left out or all
    is blurred; from 0.03 in a filmed model of which one part was given another scale."""
    max_loose_moving_share: float = Field(default=0.001, gt=0)
    """The same, times the share of the matches that move otherwise than the cameras say.  Measured:
    up to 0.00023 for right cameras of real clips, 0.0003 to 0.0009 behind watermarks, a sea or a
    person who fills the picture; from 0.00043 for wrong ones, whose second solution fails too."""
    max_distance_ratio: float = Field(default=6.0, gt=1)
    """By how much the background's median distance changes from one keyframe to the next.
    Measured: up to 1.9 on right real clips, 2.6 with their frames shuffled; from 14 where pieces of
    another scale were joined."""
    min_second_share: float = Field(default=0.5, ge=0, le=1)
    """Share of the keyframes of a second solution, of a part of them alone, that get a camera.
    Measured: 1 for most right real clips, 0.57 of a phone that goes round a fox, 0.5 at least,
    where the second half of the frames was reversed."""
    max_again_deg: float = Field(default=1.0, gt=0)
    """Root mean square of the angles between the cameras and those of a second solution, of a
    part of the keyframes and by another seed [degrees]."""
    max_again_share: float = Field(default=0.03, gt=0)
    """The same of the distances between their places, as a share of the path's extent."""
    max_cuts_share: float = Field(default=0.05, ge=0)
    """Share of the steps between images at which the picture changes to another place, or the
    camera jumps."""
    min_frames_in_place: int = Field(default=10, ge=0)
    """Frames that a camera needs that is said to stay in its place: over fewer it hardly leaves it
    anyway."""
    min_inliers: int = Field(default=25, ge=0)
    """Background points or matches that hold a frame's camera."""
    max_turn_deg_per_s: float = Field(default=500.0, gt=0)
    """Turning speed of the camera from one frame to the next [degrees/s]."""
    max_focal_deviation: float = Field(default=0.01, gt=0, lt=1)
    """Difference of the focal length that the background asks for from the given one, as a share of
    it, that is still right.  Measured: up to 2.8 % at 1.4 % of standard error on real clips with
    the right one; 5 to 11 % where the given one is 10 % off, as matches that fit it were kept."""
    max_focal_turn_deg: float = Field(default=1.5, gt=0)
    """What the standard error of the focal length leaves open of the turns of a camera that stays
    in its place, or whose focal length is a guess [degrees]."""
    focal_sigmas: float = Field(default=2.0, ge=0)
    """By how many standard errors it must be larger to be called wrong."""
