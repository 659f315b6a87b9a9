"""Whether cameras can be trusted."""
