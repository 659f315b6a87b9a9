"""What moves in the picture."""
