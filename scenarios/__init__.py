"""One file per question; `python -m scenarios.NAME --help` is its manual."""
