"""Blind trials: draw effects, diagnose without the truth, and score the answers.

What to use when: `strata` lists the kinds of trials and their bars; `generation` draws
a trial from its seed and records it, `effects` draws site, form and size of an effect,
`arms` an arm, or all effects of one; `visibility` computes the size of an effect as χ²,
`oracle` gives its distance from the library and its χ² beside all others, from their
`linear_model`; `run` has it answered by `method_under_test` in another process and
commits to the truth before; `score` marks an answer, `rates` and `report` give the
shares that are right.
"""
