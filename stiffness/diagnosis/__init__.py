"""Where a simulation and a recording differ: detected, placed, named, or left open.

What to use when: `diagnose.diagnose` for the whole answer; `detect`, `locate`, `name`
for one step of it; `hypotheses` for what is known to make arms differ from models.
"""
