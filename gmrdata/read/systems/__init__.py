"""Results of other systems, one file per system, as `gmrdata.values.estimated` has people."""
