# SPDX-License-Identifier: GPL-3.0-or-later
"""Picture textures, drawn with numpy from a seed: detail at every scale, and none of it repeats.

All are (H, W, 3) float32 sRGB in 0..1, with row 0 at the top.
"""
