"""Two encoders on either side of a gear: effects in the gear and in the measurement.

Any axis of any arm that moves while both are read. `delays.across` for all axes of a
recording, `selecting.between` for one. A term is believed when motions that it was not
fitted to confirm it and when it does not live on the delay that all axes share.
"""
