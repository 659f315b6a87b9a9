"""Reader of Human3.6M (Ionescu et al. 2014) with SMPL parameters, as JSON files per subject."""
