"""gmrdata: world-frame human motion data and the GMR network.

`docs/` and `manifests/FORMAT.md` give the conventions; every public function's docstring gives
shapes, units and frames.
"""

__version__ = "0.1.0"
