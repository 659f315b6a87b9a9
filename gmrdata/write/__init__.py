"""Every file for others."""
