"""The thresholds of a verdict; the recipe holds them."""

from pydantic import Field

from gmrdata.config import Config


class VerdictConfig(Config):
    """What a sequence and its frames must keep to."""

    min_registered_share: float = Field(default=0.7, ge=0, le=1)
    """Share of the images that have a camera."""
    max_reprojection_px: float = Field(default=1.0, gt=0)
    """Mean reprojection error of the background [px]."""
    max_scale_sigma_share: float = Field(default=0.06, gt=0)
    """Standard error of the metric scale, as a share of the scale.  Of a camera that hardly travels
    it may be larger: `scale.slow_m_per_s`."""
    max_cue_disagreement: float = Field(default=3.5, gt=0)
    """Difference between two cues of the scale, in its standard errors."""
    max_cuts_share: float = Field(default=0.05, ge=0)
    """Share of the steps between images at which the picture changes to another place, or the
    camera jumps."""
    min_kept_share: float = Field(default=0.5, ge=0, le=1)
    """Share of the frames for which the data set vouches that must be left."""
    min_inliers: int = Field(default=25, ge=0)
    """Background points or matches that hold a frame's camera."""
    max_speed_m_per_s: float = Field(default=8.0, gt=0)
    """Speed of the camera from one frame to the next [m/s]."""
    max_turn_deg_per_s: float = Field(default=500.0, gt=0)
    """Turning speed of the camera from one frame to the next [degrees/s]."""
    window_s: float = Field(default=0.5, gt=0)
    """Time over which camera motion is compared with the data set's own [s]."""
    max_window_deg: float = Field(default=4.0, gt=0)
    """Difference from the data set's own rotation over that time [degrees]."""
    max_window_m: float = Field(default=0.25, gt=0)
    """Difference from the data set's own displacement over that time [m]."""
    max_focal_deviation: float = Field(default=0.1, gt=0, lt=1)
    """Difference of the focal length that the background asks for from the given one, as a share of
    it, that is still right."""
    focal_sigmas: float = Field(default=3.0, ge=0)
    """By how many standard errors it must be larger to be called wrong."""
    min_run_s: float = Field(default=0.0, ge=0)
    """A kept range is at least this long [s]; the default keeps single frames too."""
