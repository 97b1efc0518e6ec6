"""Where a simulation and a recording differ: detected, placed, named, or left open.

What to use when: `diagnose.diagnose` for the whole answer, `setup_check` for mistakes
of the set-up alone. The effects that can be named are in `stiffness.effects`.
"""
