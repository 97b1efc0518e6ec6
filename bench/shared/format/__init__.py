"""Format of recordings on disk: a manifest and a table of samples, in one folder.

Reading goes `folder` (what lies there) → `manifest` (recording.toml) and `table` with
`columns` and `cells` (the samples) → `checks` (do they fit each other and the robot?)
→ `assembly` (visits, stages, and a `Recording`, and back). What is wrong is collected
in `faults`.
"""
