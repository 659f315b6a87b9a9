"""Every file that others wrote."""
