"""One sequence from frames to verdict."""
