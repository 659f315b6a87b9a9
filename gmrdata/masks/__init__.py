"""Dynamic-object masks."""
