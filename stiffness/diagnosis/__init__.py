"""Where a simulation and a recording differ: detected, placed, named, or left open.

What to use: `diagnose.diagnose` for the whole answer. Mistakes of the set-up are found
by `stiffness.setup`; the effects that can be named are in `stiffness.effects`.
"""
