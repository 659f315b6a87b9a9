"""The recipe of a pseudo ground truth: its metric scale, and the thresholds of its verdict."""

from pydantic import Field
from pydantic.dataclasses import dataclass as part

from gmrdata.cameras.recipe import CamerasVerdictConfig
from gmrdata.values import limits
from gmrdata.values.camera_motion import MotionClassConfig
from gmrdata.values.records import PART, Config
from gmrdata.world.verdict import Override


class ScaleConfig(Config):
    """How metric scale is found."""

    slip_m_per_s: float = Field(default=0.25, gt=0)
    """Speed below which a foot point may be planted [m/s]."""
    slip_floor_m: float = Field(default=0.005, gt=0)
    """Distance between frames that counts as standing still at any frame rate [m]."""
    residual_m: float = Field(default=0.005, gt=0)
    """Distance from its stance's mean at which a planted point's weight is halved (Cauchy) [m]."""
    creep_m_per_s: float = Field(default=0.015, ge=0)
    """Speed at which planted feet creep in one direction; part of the error bar.  On 55 CMU takes
    exact feet made the scale too small by 0.5 % (circling camera) to 1.1 % (tracking camera), which
    is 0.01 m/s relative to those cameras.  Where joints err slowly by 2 to 4 degrees, 69 % of 96
    scales lay within one and 96 % within two standard errors at 0.015, 58 % and 85 % at 0.01
    [m/s]."""
    grid_steps: int = Field(default=600, ge=50, le=100_000)
    """Scales that the search tries."""
    min_stances: int = Field(default=2, ge=1)
    """Planted feet that a scale needs at least."""
    ground_radius_m: float = Field(default=2.5, gt=0)
    """The ground is what lies this near to planted feet, seen from above [m]."""
    ground_height_m: float = Field(default=0.4, gt=0)
    """And this near to them in height, while the scale is only roughly known [m]."""
    ground_inlier_m: float = Field(default=0.03, gt=0)
    """Distance from the plane of the ground at which a point's weight is halved (Cauchy) [m]."""
    min_ground_points: int = Field(default=25, ge=3)
    """Points on the ground that its plane needs at least."""
    contact_sigma_m: float = Field(default=0.012, gt=0)
    """Standard error of the body's soles above the ground, the same in all frames [m]."""
    body_share: float = Field(default=0.01, ge=0)
    """What all cues of bodies have in common, such as a wrong size, as a share; part of the error
    bar.  Scales under simulated faults are off by 0.5 % (RMS, benchmarks/bench_scale_cues.py),
    which is each cue's own: bodies of a wrong size are not in that."""
    slow_m_per_s: float = Field(default=0.02, ge=0)
    """Error of the camera's speed up to which the scale need not be known any better, however
    large its error is as a share: of a camera that hardly travels; 2 mm in 0.1 s [m/s]."""
    vague_share: float = Field(default=0.5, gt=0)
    """Standard error, as a share of the scale, beyond which the scale of such a camera is said to
    be unknown, and the camera to stay in place."""
    window_s: float = Field(default=1.0, gt=0, le=limits.LONGEST_S)
    """Time over which a data set's own camera path is compared [s]."""
    drift_m_per_s: float = Field(default=0.15, ge=0)
    """Speed at which such a path may drift along its own direction, which nothing shows: 0.8 m in
    5 s, or 2 degrees/s about a person 4 m away; part of the error bar [m/s]."""
    drift_time_s: float = Field(default=4.0, gt=0)
    """Time over which the drift of such a path keeps its direction: windows this far apart count as
    independent [s]."""

    def slip_m(self, fps_hz: float) -> float:
        """Distance between frames below which a foot point may be planted [m]."""
        return self.slip_floor_m + self.slip_m_per_s / fps_hz


@part(frozen=True, config=PART)
class CueEstimate:
    """What one source of evidence says about the scale."""

    name: str
    """"planted_feet", "ground_contact" or "short_windows"."""
    scale: float
    """Metres per unit of the reconstruction."""
    sigma: float
    """Its standard error."""
    support: int
    """Independent observations behind it: stances, points of the ground, or windows."""
    residual_m: float
    """Root mean square of what the cue leaves unexplained [m]."""
    person: int | None
    """Whose feet, counted from 0; None for a cue that needs nobody."""


class VerdictConfig(CamerasVerdictConfig):
    """What a sequence and its frames must keep to, besides what is asked of cameras alone."""

    max_scale_sigma_share: float = Field(default=0.06, gt=0)
    """Standard error of the metric scale, as a share of the scale.  Of a camera that hardly travels
    it may be larger: `scale.slow_m_per_s`."""
    max_cue_disagreement: float = Field(default=3.5, gt=0)
    """Difference between two cues of the scale, in its standard errors."""
    min_kept_share: float = Field(default=0.5, ge=0, le=1)
    """Share of the frames for which the data set vouches that must be left."""
    max_off_share: float = Field(default=0.5, gt=0)
    """Share of the frames in which the body does not lie on a person in the picture."""
    off_overlap: float = Field(default=0.5, gt=0, le=1)
    """Overlap, as intersection over union, below which a body does not lie on a person: 0.71 and
    more for right bodies with errors, 0.45 and less for others' (docs/video.md)."""
    max_late_gain: float = Field(default=0.08, gt=0)
    """By how much the body may lie better on the people of other frames than on those of its own.
    Measured: 0 for right bodies, also with 8 degrees of error at each joint; 0.15 and more where
    they are five frames off at 10 frames/s, 0.3 and more for twenty."""
    min_joint_deg: float = Field(default=1.0, ge=0)
    """Turn of the joints from their mean pose, in the most a person shows of it (95 % of joints and
    frames turn less), that a body needs that travels by `stiff_travel_m`: less is no person
    [degrees]."""
    stiff_travel_m: float = Field(default=1.0, gt=0)
    """Way from which a body must move its joints [m]."""
    max_speed_m_per_s: float = Field(default=8.0, gt=0)
    """Speed of the camera from one frame to the next [m/s]."""
    window_s: float = Field(default=0.5, gt=0)
    """Time over which camera motion is compared with the data set's own [s]."""
    max_window_deg: float = Field(default=4.0, gt=0)
    """Difference from the data set's own rotation over that time [degrees]."""
    max_window_m: float = Field(default=0.25, gt=0)
    """Difference from the data set's own displacement over that time [m]."""
    min_run_s: float = Field(default=0.0, ge=0)
    """A kept range is at least this long [s]; the default keeps single frames too."""


class PseudoGtConfig(Config):
    """Metric world poses from cameras up to scale.  The people are not smoothed."""

    scale: ScaleConfig = ScaleConfig()
    verdict: VerdictConfig = VerdictConfig()
    override: Override | None = None
    """What a person decided of the sequence."""
    motion_class: MotionClassConfig = MotionClassConfig()
    """Where one class of camera motion ends and the next begins."""
