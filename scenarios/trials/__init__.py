"""A blind trial conceals an effect, asks the diagnosis, and opens the truth last.

What to use when: `strata` says what is tried and how well it has to go, `draw` draws a
trial from its seed, `effects` one effect, `sizing` makes it as large as is asked,
`weight` says how large it is, `oracle` what the best names of the library would leave
of it; `make` carries a trial out, `ask` and `answer` put it to the diagnosis in another
process, `seals` keep both apart; `score` marks an answer, `rates` and `report` say how
many were right.
"""
