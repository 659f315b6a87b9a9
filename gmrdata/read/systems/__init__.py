"""Results of other systems, one file per system, as `gmrdata.values.people` has people."""
