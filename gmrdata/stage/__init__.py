"""How work is run and kept: stages, recipes, jobs, progress."""
