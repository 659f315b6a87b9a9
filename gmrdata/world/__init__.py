"""Metric scale, level, R_w = R_col R_c, and a verdict: one sequence."""
