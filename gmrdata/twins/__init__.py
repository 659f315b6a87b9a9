"""3DPW's rendered twin, and the noise floor."""
