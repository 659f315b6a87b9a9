"""The plot of a person by cameras and a network together: all that it shows is there to see."""

import numpy as np
from matplotlib.figure import Figure

from gmrdata.pages.fusion import plot_person
from gmrdata.values.clip import Clip


def test_gaps_lie_on_grey_behind_the_error_bars(walkers: list[Clip]) -> None:
    clip = walkers[0]
    n_frames, fps_hz = clip.motion.n_frames, clip.motion.fps_hz
    has_camera = np.ones(n_frames, dtype=bool)
    has_camera[[4, 7, 8]] = False
    sigma = {
        "place_sigma_m": np.tile([0.1, 0.2, 0.2], (n_frames, 1)),
        "turn_sigma_deg": np.full((n_frames, 3), 5.0),
        "has_camera": has_camera,
    }
    plot = Figure()
    plot_person(plot, clip, sigma)
    *places, place, turn = plot.axes
    assert [axes.get_ylabel() for axes in places] == ["x [m]", "y [m]", "z [m]"]
    for axis, axes in enumerate(places):
        (line,), (band,) = axes.get_lines(), axes.collections
        np.testing.assert_array_equal(line.get_ydata(), clip.motion.pelvis_m[:, axis])
        heights = band.get_paths()[0].vertices[:, 1]
        reach_m = 2 * sigma["place_sigma_m"][0, axis]
        assert np.isclose(heights.min(), clip.motion.pelvis_m[:, axis].min() - reach_m)
        assert all(patch.get_zorder() < band.get_zorder() for patch in axes.patches)
    np.testing.assert_allclose(place.get_lines()[0].get_ydata(), np.sqrt(0.09 / 3))
    np.testing.assert_allclose(turn.get_lines()[0].get_ydata(), 5.0)
    for axes in plot.axes:
        spans = [
            patch.get_path().transformed(patch.get_patch_transform()) for patch in axes.patches
        ]
        ends_s = [(span.vertices[:, 0].min(), span.vertices[:, 0].max()) for span in spans]
        np.testing.assert_allclose(np.array(ends_s) * fps_hz, [(3.5, 4.5), (6.5, 8.5)])
