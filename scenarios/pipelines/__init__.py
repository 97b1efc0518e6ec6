"""Bench and claims together: diagnose, calibrate, compare encoders, import, check.

What to use when: `diagnose`, `calibrate` and `compare_encoders` ask one engine and
prove what it found, `patching` turns names into mechanisms, `schema` is the form of
diagnosis.json with its verdict, `next_experiments` says what to measure next.
Nothing here knows of pages or folders: `scenarios.report` writes what comes out.
"""
