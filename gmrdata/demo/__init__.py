"""The demo: from motions to a scored GMR and a report, through every stage."""
