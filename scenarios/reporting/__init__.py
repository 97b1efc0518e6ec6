"""A result is handed over as a page that one reads and a table that one computes with.

`page` writes report.md and report.html from the same blocks, `table` tidy csv files,
`style` gives every figure the same look, `run_file` says how a result came about.
"""
