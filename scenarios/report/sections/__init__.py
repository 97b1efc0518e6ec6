"""Sections of the reports, one module for each kind of result."""
