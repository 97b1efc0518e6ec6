"""Regression: normal equations, elimination, tests, splits, intervals."""
