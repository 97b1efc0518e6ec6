"""Blind trials: conceal effects, diagnose without the truth, and score the answers.

What to use when: `strata` says what is tried and how well it has to go, `draw` draws a
trial from its seed, `effects` one effect, `magnitudes` makes it as large as is asked,
`visibility` says how large it is, `oracle` what the best names of the library would
leave of it; `generation` carries a trial out, `run` puts it to `method_under_test` in
another process and commits to the truth before; `score` marks an answer, `rates` and
`report` say how many were right.
"""
