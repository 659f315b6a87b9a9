"""Extras: people and cars that move through a clip beside the person whose motion is its truth."""
