"""A diagnosis is told: in a file for programs, a report for people, and a playback.

What to use when: `patching` turns names into mechanisms, `answer` writes
diagnosis.json, `story` says it in sentences, `report` and `pictures` make the page,
`playback` the recording for the viewer, `next_experiments` says what to measure next.
"""
