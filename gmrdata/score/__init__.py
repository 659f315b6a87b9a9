"""Metrics, protocols, intervals, comparison."""
