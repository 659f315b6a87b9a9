"""Motion, its readers, retargeting, resampling, and the embedded gait."""
