"""Reader and writer of the 3DPW layout (von Marcard et al. 2018)."""
