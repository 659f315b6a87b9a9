"""Metrics, protocols, intervals, comparison; here are their names, light to import."""

from typing import Literal

Metric = Literal["ome_deg", "tme_mm", "vme_mm"]
METRICS: tuple[Metric, ...] = ("ome_deg", "tme_mm", "vme_mm")  # the paper's errors (eqs. 15-17)
Method = Literal["predicted", "zero"]
METHODS: tuple[Method, ...] = ("predicted", "zero")
"""What was predicted, and a body that neither turns nor moves."""
WorldMetric = Literal[
    "w_mpjpe_mm", "wa_mpjpe_mm", "rte_percent", "roe_deg", "erve_mm_per_frame",
    "jitter_10m_per_s3", "foot_sliding_mm",
    "accel_length_error_mm_per_frame2", "ate_m", "ate_s_m",
]  # fmt: skip
"""Errors of a person, or of the camera (ATE), in the world."""
CameraMetric = Literal[
    "pa_mpjpe_mm", "mpjpe_mm", "pve_mm", "pa_pve_mm", "mpjae_deg", "pa_mpjae_deg",
    "accel_error_m_per_s2", "accel_mm_per_frame2", "accel_error_mm_per_frame2",
]  # fmt: skip
"""Errors of a person's pose as the camera sees it."""
ProtocolMetric = Literal[WorldMetric, CameraMetric]
ProtocolName = Literal["gmr", "wham", "tram", "gvhmr", "slahmr", "emdb", "vibe"]
Deviation = Literal["gaps", "camera", "people", "smoothing"]
"""Where a protocol does not follow the released code unless it is asked to."""
SeenIn = Literal["own_camera", "true_camera", "world"]
"""How a prediction came into the camera's frame: seen by a camera of its own; turned so that its
first orientation is the true one and seen by the truth's camera; or so turned, without a camera."""
SeenAs = Literal["ignored", "true"]
"""How a motion in the camera's frame becomes one in the world: as if the camera stood still, or by
the manifest's cameras."""
Remainder = Literal["own_segment", "joined_but_last_frame", "joined"]
"""What becomes of the frames after the last full segment; see `metrics.segments_of`."""
Interval = tuple[float, float]  # lower and upper end
