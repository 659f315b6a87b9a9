"""The lens: what is given, what the frames say, and a guess where neither is."""
