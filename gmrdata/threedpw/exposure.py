"""Changes of exposure put into images: a phone's camera that never stops metering.

The gain is one factor of the light for a whole frame.  It wanders, and now and then an automatic
exposure corrects it within a fraction of a second.
"""

import numpy as np
from pydantic import Field, model_validator

from gmrdata.config import Config
from gmrdata.errors import BadFrames
from gmrdata.threedpw.smooth_noise import smooth_noise, with_peak

WANDER = 0.5
"""How far the gain wanders to either side, as a share of one correction."""
SMALLEST_SHARE = 0.6
"""A sequence uses at least this share of the range (of its logarithm)."""
UNCHANGED = (1.0, 1.0)


class ExposureConfig(Config):
    """How the exposure of a twin's images changes.  Ranges are (least, most)."""

    gain: tuple[float, float] = (0.7, 1.4)
    """Light of the darkest and the brightest frame that there may be, as factors of what was
    rendered.  (1, 1): the images stay as they are, byte for byte."""
    period_s: float = Field(default=3.0, gt=0)
    """The slow part has no shorter period [s]."""
    steps: tuple[int, int] = (1, 2)
    """Corrections of the automatic exposure in a sequence."""
    step_s: tuple[float, float] = (0.15, 0.5)
    """How long a correction takes [s]."""
    jpeg_quality: int = Field(default=92, ge=1, le=100)
    """Quality of the images, which are encoded once more."""

    @model_validator(mode="after")
    def _ranges(self) -> "ExposureConfig":
        for name, value in self:
            if isinstance(value, tuple) and not 0 <= value[0] <= value[1]:
                raise ValueError(f"{name} is {value}: give (least, most), neither below 0")
        if self.gain[0] == 0 or self.step_s[0] == 0:
            raise ValueError("gain and step_s must be above 0")
        return self


def exposure_gains(
    n_frames: int, fps_hz: float, config: ExposureConfig, rng: np.random.Generator
) -> np.ndarray:
    """Gain of each frame (N,), inside `config.gain`.

    Args:
        n_frames: Number of frames N.
        fps_hz: Their rate [Hz].
        config: How exposure changes.
        rng: Source of the wander and of the corrections.
    """
    slow = smooth_noise(n_frames, fps_hz, config.period_s, 1, rng)
    curve = WANDER * with_peak(slow, 1.0)[:, 0]
    times_s = np.arange(n_frames) / fps_hz
    for _ in range(rng.integers(config.steps[0], config.steps[1] + 1)):
        start_s = rng.uniform(0.1, 0.9) * times_s[-1]
        share = np.clip((times_s - start_s) / rng.uniform(*config.step_s), 0.0, 1.0)
        curve += rng.choice([-1.0, 1.0]) * share**2 * (3 - 2 * share)
    least, most = np.log(config.gain)
    used = (most - least) * rng.uniform(SMALLEST_SHARE, 1.0)
    lowest = rng.uniform(least, most - used)
    unit = (curve - curve.min()) / max(float(np.ptp(curve)), 1e-9)
    # The logarithm's last bits must not take a gain out of its range.
    return np.clip(np.exp(lowest + used * unit), *config.gain)


def exposed_jpeg(content: bytes, gain: float, jpeg_quality: int) -> bytes:
    """The JPEG of a frame as if `gain` times the light had come in; what is too bright is white.

    Raises:
        BadFrames: the bytes are no image.
    """
    import cv2

    image = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        raise BadFrames("a frame cannot be decoded; render it again")
    ok, encoded = cv2.imencode(
        ".jpg", cv2.LUT(image, _table(gain)), [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality]
    )
    if not ok:
        raise BadFrames(f"a frame of {image.shape} can't be encoded as JPEG")
    return encoded.tobytes()


def _table(gain: float) -> np.ndarray:
    """(256,) uint8: what each 8-bit sRGB value becomes (IEC 61966-2-1)."""
    value = np.arange(256) / 255
    light = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    light = np.minimum(gain * light, 1.0)
    value = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.round(255 * value).astype(np.uint8)
