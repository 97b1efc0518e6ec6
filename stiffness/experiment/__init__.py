"""Experiments as data: visits, static states, residuals, deflections, noise."""
