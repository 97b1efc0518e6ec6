"""How many poses are enough: every method learns from 5 to 121."""
