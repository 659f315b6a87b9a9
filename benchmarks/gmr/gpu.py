"""The step at the paper's size on a GPU, beside the bare cuDNN step."""

from typing import Any

import torch
from gmr.steps import bare_step, our_step, recipe, workload
from gmr.timing import paired

from gmrdata.values.body import BodyModel
from tests.gmr.direct_reading import parameter_count

LAYERS, HIDDEN, BATCH, FRAMES, PAIRS = 4, 2048, 32, 64, 20
PRODUCT_SIZE, PRODUCTS = 8192, 10
"""A product of square matrices, and how often: what the GPU reaches is taken for its peak."""


def measure_gpu(body: BodyModel) -> list[dict[str, Any]]:
    """Ratios at 4 x 2048 in bf16 and fp32, with the share of the peak that our step reaches."""
    return [_measure(body, precision) for precision in ("bf16", "fp32")]


def _measure(body: BodyModel, precision: str) -> dict[str, Any]:
    config = recipe(LAYERS, HIDDEN, BATCH, FRAMES, device="cuda", precision=precision)
    work = workload(config, body)
    row = paired(our_step(work), bare_step(work), PAIRS, ("ours", "bare"), device="cuda")
    # Each weight is met once in each frame, and twice more in the backward pass.
    work_flop = 6 * parameter_count(config.model) * BATCH * FRAMES
    peak = _peak_flop_per_s(torch.bfloat16 if precision == "bf16" else torch.float32)
    return {
        "gpu": torch.cuda.get_device_name(),
        "precision": precision,
        **row,
        "tflop_per_s": work_flop / row["ours_s"] / 1e12,
        "peak_tflop_per_s": peak / 1e12,
        "share_of_peak": work_flop / row["ours_s"] / peak,
    }


def _peak_flop_per_s(dtype: torch.dtype) -> float:
    """Of a large matrix product, with the same use of tensor cores that cuDNN's GRUs make."""
    a = torch.randn(PRODUCT_SIZE, PRODUCT_SIZE, device="cuda", dtype=dtype)
    allowed = torch.backends.cuda.matmul.allow_tf32
    torch.backends.cuda.matmul.allow_tf32 = torch.backends.cudnn.allow_tf32
    try:
        row = paired(
            lambda _: _products(a), lambda _: None, 3, ("product", "nothing"), device="cuda"
        )
    finally:
        torch.backends.cuda.matmul.allow_tf32 = allowed
    return float(2 * PRODUCT_SIZE**3 * PRODUCTS / row["product_s"])


def _products(a: torch.Tensor) -> None:
    for _ in range(PRODUCTS):
        a @ a
