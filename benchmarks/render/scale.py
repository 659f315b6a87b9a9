"""How large the measurements of the renderer are."""

from dataclasses import dataclass

from render.clips import MOVING, PROGRAMMES


@dataclass(frozen=True)
class Scale:
    """Sizes of what is rendered and how often; the bars hold for `FULL`."""

    overhead_frames: int
    """Frames of the clip whose wall time is compared: Table 8's mean is about 5 s at 10 fps."""
    overhead_runs: int
    """Clips, with a bare render before the first and after each."""
    overhead_sizes_px: tuple[tuple[int, int], ...]
    """(width, height); the ratio that counts is that of the first."""
    script_frames: int
    """Frames that the script makes which sets up the scene anew for each."""
    pool_clips: int
    """Clips that one worker renders, and then two."""
    pool_frames: int
    """Frames of each of them."""
    exact_sizes_px: tuple[tuple[int, int], ...]
    """Sizes of the clips of each programme that are compared with their geometry."""
    exact_frames: int
    """Frames of each of them."""
    exact_programmes: tuple[str, ...]
    """Camera programmes that are compared."""
    sfm_size_px: tuple[int, int]
    """Size of the clips that the COLMAP stage gets."""
    sfm_frames: int
    """Frames of each of them, at 10 fps."""
    sfm_places: tuple[str, ...]
    """Places that they are filmed in."""
    sfm_programmes: tuple[str, ...]
    """Camera programmes that they are filmed with."""


FULL = Scale(
    overhead_frames=50,
    overhead_runs=5,
    overhead_sizes_px=((480, 270), (640, 360)),
    script_frames=4,
    pool_clips=4,
    pool_frames=30,
    exact_sizes_px=((480, 270), (640, 360)),
    exact_frames=5,
    exact_programmes=tuple(PROGRAMMES),
    sfm_size_px=(480, 270),
    sfm_frames=12,
    sfm_places=("courtyard", "street", "park", "room"),
    sfm_programmes=tuple(MOVING),
)

SMALL = Scale(
    overhead_frames=5,
    overhead_runs=1,
    overhead_sizes_px=((160, 90),),
    script_frames=2,
    pool_clips=2,
    pool_frames=5,
    exact_sizes_px=((160, 90),),
    exact_frames=5,
    exact_programmes=("circular", "panning_handheld"),
    sfm_size_px=(320, 180),
    sfm_frames=6,
    sfm_places=("courtyard",),
    sfm_programmes=("circular", "panning"),
)
