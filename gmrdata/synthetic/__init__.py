"""Synthetic sets: motions under camera programmes, rendered with exact truth."""
