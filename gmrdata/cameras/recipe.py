"""The recipe of structure from motion, and the thresholds that its cameras must keep to.

What was measured for a threshold stands in docs/figures.md.
"""

from typing import Self

from pydantic import Field, model_validator

from gmrdata.values import limits
from gmrdata.values.records import Config


class FeaturesConfig(Config):
    """SIFT features, by the size of the frames and by how many there are."""

    large_pixels: int = Field(default=500_000, ge=1)
    """Frames from so many have OpenCV's features, which take a third of the time of COLMAP's."""
    small_pixels: int = Field(default=250_000, ge=0)
    """Frames with fewer are doubled, which finds twice as many matches in them."""
    contrast: float = Field(default=0.02, gt=0)
    """Least contrast of OpenCV's features; COLMAP has the same."""
    weak_contrast: float = Field(default=0.01, gt=0)
    """The same where few are outside masks: weak ones hold a camera better than none."""
    few_features: int = Field(default=1000, ge=0)
    """Median of the features outside masks below which weak ones are taken too."""


class BehindMasksConfig(Config):
    """When background inside masks comes back."""

    hardly_matched: int = Field(default=50, ge=0)
    """Matches below which two neighbours hardly match: then what a mask hides is missed."""
    often: float = Field(default=0.25, gt=0, le=1)
    """Share of neighbours that hardly match, from which features inside masks are matched too; it
    takes as long again."""
    again_px: float = Field(default=1.5, gt=0)
    """Distance from where a point must appear, within which a feature inside a mask may show it."""
    again_likeness: float = Field(default=0.9, gt=0, le=1)
    """Cosine of two descriptors from which they show one point, and not clothes like the wall."""
    again_seen: int = Field(default=3, ge=2)
    """Frames that must see a point outside their masks, so that nobody comes in who moves."""


class MappingConfig(Config):
    """Models by COLMAP's mappers, and how they are made better."""

    small_start_deg: float = Field(default=0.5, gt=0)
    """Parallax of the first pair where the camera hardly leaves its place; COLMAP's usual 16 find
    no pair there.  About a hand's 5 cm before a background 5 m away."""
    least_explained: float = Field(default=0.4, ge=0, le=1)
    """Share of its frames' matched points below which a model is doubted, and a mapper tried that
    asks for less parallax."""
    long_frames: int = Field(default=40, ge=2)
    """Keyframes from which on the global mapper places each by few tracks, for a quarter of the
    time; fewer need all tracks."""
    part_frames: int = Field(default=100, ge=5)
    """Keyframes that are mapped at once; of more, parts are mapped that share `part_overlap` of
    them, and joined by one adjustment, as a mapper takes three times as long for twice as many."""
    part_overlap: int = Field(default=25, ge=3)
    """Keyframes that a part shares with the next."""
    near_overlap: int = Field(default=6, ge=1, le=1000)
    """As `overlap`, of a video of more than one part: what is further on is matched where it looks
    alike, so that the number of matches of a place does not grow with how often it is seen."""
    alike: int = Field(default=3, ge=0)
    """Keyframes further back that each is matched with then, those that look like it the most."""
    cover_times: int = Field(default=3, ge=2)
    """Other keyframes that must see a point, so that a keyframe of such a video is not needed for
    it."""
    cover_share: float = Field(default=0.8, gt=0, le=1)
    """Share of its points for which a keyframe must not be needed, to leave the adjustment; share
    of its matches that must go to much earlier ones, for it not to be mapped at all."""
    least_held: float = Field(default=0.2, ge=0, le=1)
    """Share of a keyframe's matched points below which it is weak: its place may be wrong, and
    little leads it back."""
    triangulated_again: int = Field(default=2, ge=0)
    """How often the points of all keyframes are made anew then; a third time changes nothing."""
    min_triangulation_deg: float = Field(default=1.0, gt=0)
    """Least angle of a point that is made anew: with less it has no depth to hold a keyframe by."""
    jump: float = Field(default=5.0, gt=0)
    """Distance of a keyframe from the middle between its neighbours, in medians over the path,
    beyond which it may have jumped."""
    jump_gain: float = Field(default=0.001, ge=0, lt=1)
    """Share of the cost of its points by which it must be better where it ends from the middle, so
    that what merely moves fast stays."""
    most_jumps: int = Field(default=10, ge=0)
    """Keyframes that are tried so at most, since each takes an adjustment."""
    most_zoom_spread: float = Field(default=0.01, ge=0)
    """Spread of the focal lengths that single keyframes ask for, as a share, above which the lens
    zooms: fixed ones, wrong ones too, have half of it, a zoom by a third five times."""

    def in_parts(self, n_keyframes: int) -> bool:
        """Whether so many are more than one part has: what is done of long videos alone."""
        return n_keyframes > self.part_frames

    @model_validator(mode="after")
    def _parts_reach_further(self) -> Self:
        if self.part_overlap >= self.part_frames:
            raise ValueError("part_overlap must be less than part_frames")
        return self


class JoiningConfig(Config):
    """When two models that share frames become one."""

    min_shared_points: int = Field(default=12, ge=3)
    """Points that both must have; three fix a similarity, more say whether it is right."""
    min_common_observations: int = Field(default=2, ge=1)
    """Image points by which points of both are known to be one."""
    point_error_share: float = Field(default=0.05, gt=0)
    """How far apart the two may be, as a share of the way to the camera: depths vary."""
    min_inlier_share: float = Field(default=0.5, gt=0, le=1)
    """Share of the shared points that must agree with the similarity."""
    max_shared_error_px: float = Field(default=4.0, gt=0)
    """Median distance of one model's points in the other's shared cameras [px]."""
    max_part_error_px: float = Field(default=12.0, gt=0)
    """The same where they share as many frames as parts of a long video do: each part is adjusted
    alone, right ones were up to 6 px off, and one that is left out costs all behind it."""


class DistortionConfig(Config):
    """When radial distortion is taken out of the image points."""

    least_share: float = Field(default=0.02, ge=0, le=1)
    """Share of the cost that it must take away: bent lenses do, straight ones not by far."""
    min_observations: int = Field(default=1000, ge=0)
    """Fewer image points fit any lens better."""
    least_stretch: float = Field(default=0.5, gt=0)
    """Of the picture along the radius; a lens that folds it is none."""


class ChoiceConfig(Config):
    """The choice between a camera that only turns and one that also moves."""

    parallax_growth: float = Field(default=2.5, gt=0)
    """Residuals of the worst tenth of pairs over those of the best, above which parallax may show;
    pans stay well below."""
    parallax_px: float = Field(default=0.5, ge=0)
    """Residuals of the worst tenth of pairs below which parallax does no harm [px]."""
    clearly_better: float = Field(default=0.7, gt=0)
    """Share of the median residual that makes six degrees of freedom worth it."""
    nearly_turns: float = Field(default=0.6, ge=0, le=1)
    """Share of the matches that make a pure rotation the likeliest where nothing can be solved."""
    least_covered: float = Field(default=0.5, ge=0, le=1)
    """Share of the picture's cells that a turn must explain: a logo stays in its place too."""
    vague_focal: float = Field(default=0.02, ge=0)
    """A model whose focal length is more uncertain, and that no second one confirms, is held by
    little parallax."""


class SecondConfig(Config):
    """A second solution, of a part of the keyframes, that must confirm the first."""

    few_keyframes: int = Field(default=5, ge=3)
    """Mappers want more frames than the three that a model needs."""
    well_matched: int = Field(default=50, ge=0)
    """Matches of its neighbours without which it keeps a keyframe: it must hold together as the
    first solution does."""
    enough_share: float = Field(default=0.5, ge=0, le=1)
    """Share of its keyframes with a camera, below which one of more keyframes is tried."""
    same_deg: float = Field(default=1.0, ge=0)
    """Up to which the turns of both give the same path; as the verdict has it [degrees]."""
    same_share: float = Field(default=0.03, ge=0)
    """And the places, as a share of the path's extent."""
    starts: int = Field(default=2, ge=1)
    """Of the mapper, at most, where the camera hardly travels: one in four ends elsewhere."""
    agreeing_share: float = Field(default=0.03, ge=0)
    """Of its extent, to which two solutions of a path that hardly travels agree."""
    most_of_them: float = Field(default=0.6, ge=0, le=1)
    """Share of the keyframes that a model, or a second one, needs to say that another is wrong; one
    of few keyframes does not tell how far the camera travels over all."""


class DissolveConfig(Config):
    """When the picture goes over from one place into another, and the cameras with it."""

    spans: tuple[int, ...] = (3, 5, 8, 12)
    """Keyframes from one side to the other."""
    few_cross: float = Field(default=0.2, ge=0, le=1)
    """Share of the tracks that go on over so many, beside the clip's median, below which two places
    have nothing in common but wrong matches, or a logo; in clips of one place it is above 0.3."""
    fewest_usually: int = Field(default=20, ge=1)
    """Tracks that would go on by that median: of fewer it is chance how many do."""
    most_moved: float = Field(default=0.33, ge=0, le=1)
    """Way of the picture's content meanwhile, in its shorter sides: of more, tracks end by
    themselves."""


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
    cut_share: float = Field(default=0.1, ge=0, le=1)
    """Share of the corners that survive one step, below which the two frames show different places:
    no camera moves so fast."""
    featureless_corners: int = Field(default=8, ge=0)
    """Corners below which a frame shows nothing of the background."""
    features: FeaturesConfig = FeaturesConfig()
    masks: BehindMasksConfig = BehindMasksConfig()
    mapping: MappingConfig = MappingConfig()
    joining: JoiningConfig = JoiningConfig()
    distortion: DistortionConfig = DistortionConfig()
    choice: ChoiceConfig = ChoiceConfig()
    second: SecondConfig = SecondConfig()
    dissolve: DissolveConfig = DissolveConfig()
    seed: int = Field(default=0, ge=0, le=2**31 - 1)
    """Seed of every random choice."""

    def reseeded(self, by: int) -> Self:
        """The same with another seed."""
        return self.model_copy(update={"seed": (self.seed + by) % 2**31})


class CamerasVerdictConfig(Config):
    """What cameras must keep to, up to scale and without a body."""

    min_registered_share: float = Field(default=0.7, ge=0, le=1)
    """Share of the images that have a camera."""
    max_reprojection_px: float = Field(default=1.0, gt=0)
    """Mean reprojection error of the background [px]."""
    max_loose_share: float = Field(default=0.006, gt=0)
    """What the weakest step leaves open of the cameras' places, as a share of their way: more in
    pieces that differ in scale."""
    max_loose_moving_share: float = Field(default=0.001, gt=0)
    """The same, times the share of the matches that move otherwise than the cameras say: what
    moves as one bends a path the more, the less holds it."""
    max_distance_ratio: float = Field(default=6.0, gt=1)
    """By how much the background's distance changes from one keyframe to the next, both that of
    its near tenth and the median; more where pieces of another scale were joined."""
    min_second_share: float = Field(default=0.5, ge=0, le=1)
    """Share of the keyframes of a second solution, of a part of them alone, that get a camera:
    with fewer nothing confirms the path."""
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
    max_travel_set_aside: float = Field(default=0.025, gt=0)
    """Share of the background's distance that a camera may have travelled, by a path that does not
    hold, and still be said to stay in its place."""
    max_turn_wide_median_px: float = Field(default=1.5, gt=0)
    """Median residual of a turn in the worst tenth of the pairs, above which that counts: what
    moves before a camera at rest leaves most matches in their place [px]."""
    min_inliers: int = Field(default=25, ge=0)
    """Background points or matches that hold a frame's camera."""
    max_turn_deg_per_s: float = Field(default=500.0, gt=0)
    """Turning speed of the camera from one frame to the next [degrees/s]."""
    max_focal_deviation: float = Field(default=0.01, gt=0, lt=1)
    """Difference of the focal length that the background asks for from the given one, as a share of
    it, that is still right beside its standard error."""
    max_focal_turn_deg: float = Field(default=1.5, gt=0)
    """What the standard error of the focal length leaves open of the turns of a camera that stays
    in its place, or whose focal length is a guess [degrees]."""
    focal_sigmas: float = Field(default=2.0, ge=0)
    """By how many standard errors it must be larger to be called wrong."""
    moving_background: float = Field(default=0.4, ge=0, le=1)
    """Share of what two frames share that moves otherwise than the cameras say, from which the
    background itself does; a person or a wrong focal length move less."""
    out_of_order_rows: int = Field(default=5, ge=1)
    """Rows from a camera to the nearest one in place and turn, in the median, above which images
    are out of order: it is beside it where they are in order."""
