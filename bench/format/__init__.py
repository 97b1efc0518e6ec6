"""A recording on disk is a folder with a manifest and a table, and follows one format.

Reading goes `folder` (what lies there) → `manifest` with `sections` (recording.toml)
and `samples` with `columns`, `values` (the table) → `agreement`, `plausible` (do they
fit each other and the robot?) → `course` (visits, stages) → `assembly` (a
`Recording`); writing is `disassembly`. What is wrong is collected in `faults`.
"""
