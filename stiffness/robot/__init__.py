"""Nominal robot: geometry, springs, equilibrium, wrenches and the tracker's frame."""
