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
]  # fmt: skip
ProtocolName = Literal["gmr", "wham", "tram", "gvhmr", "slahmr", "emdb"]
Remainder = Literal["own_segment", "joined_but_last_frame", "joined"]
"""What becomes of the frames after the last full segment; see `world_metrics.segments_of`."""
Interval = tuple[float, float]  # lower and upper end
