"""An arm under its own weight is calibrated: which numbers of its model are wrong.

Absolute positions of targets in many postures, no wrench. Geometry, encoder offsets,
compliance under gravity, uneven gears, tilting bearings and a wandering tracker
compete; regions of poses that were left out decide which of them is believed.
"""
