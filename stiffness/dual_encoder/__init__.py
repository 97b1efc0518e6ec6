"""Dual-encoder analysis: effects between two encoders on either side of a gear.

It applies to any axis of any arm that moves while both encoders are read:
`delays.across` for all axes of a recording, `selection.between` for one. A term is
selected when it improves the prediction of motions left out and is no artefact of the
delay that all axes share.
"""
