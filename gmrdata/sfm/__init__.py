"""The COLMAP stage: features, cameras, metric scale."""
