"""Runs in its own process: render one clip as a worker of `gmrdata render` does.

Usage: one_clip.py clip.npz body.npz OUT_DIR CONFIG_JSON.
"""

import sys
from pathlib import Path

from gmrdata.film.render import RenderConfig, render_clip

if __name__ == "__main__":
    clip_path, body_path, out_dir = (Path(word) for word in sys.argv[1:4])
    config = RenderConfig.model_validate_json(sys.argv[4])
    render_clip(clip_path, body_path, out_dir, config, on_frame=lambda _: None)
