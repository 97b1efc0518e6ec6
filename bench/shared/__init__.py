"""Shared by both sides: recordings, their format, plans, errors; no physics."""
