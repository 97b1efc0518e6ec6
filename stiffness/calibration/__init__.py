"""Calibration of an arm under its own weight: which parameters of its model are wrong.

Data: absolute positions of targets in many postures, without an applied wrench.
Candidates: geometry, encoder offsets, compliance under gravity, transmission error,
bearing tilt, hysteresis and drift of the tracker. Effects are selected by
cross-validation over spatial regions of poses.
"""
