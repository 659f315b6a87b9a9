"""Camera-frame body and cameras to world-frame clips (eqs. 6-8)."""
