"""Camera and network together, with error bars."""
