"""Results as other systems write them, one file per system."""
