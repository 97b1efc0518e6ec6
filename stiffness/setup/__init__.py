"""Mistakes of a set-up: files that are read otherwise, and loads from elsewhere."""
