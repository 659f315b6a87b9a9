"""One person over time: onto the 24-joint tree, the ground, other frame rates, embedded gait."""
