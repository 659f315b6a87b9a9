"""A whole 3DPW to a manifest."""
