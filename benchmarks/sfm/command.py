"""How a measurement calls the command line."""

GMRDATA = ("-c", "from gmrdata.cli import main; main()")
"""Words for `run_python`, before the verb."""
