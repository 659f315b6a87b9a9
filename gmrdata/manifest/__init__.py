"""Manifest v1: schema, reader, writer, check, diff."""
