"""Metrics of the paper and their scores per manifest."""
