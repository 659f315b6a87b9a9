"""A page for each sequence of a regenerated set: what was decided of it, and on what figures."""
