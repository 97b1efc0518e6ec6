"""A recording is done again in the simulator, and what it shows is held against it.

What to use when: `replay` lays out what was done, `world` simulates it and compares,
`silent` fits what is nominal, `refining` moves an effect's parameters to where the
simulator agrees best, `trials` tries the patch where it should fail, `floor` says what
the instruments alone would leave.
"""
