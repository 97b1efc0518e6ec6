"""The numbers that the 2024 paper prints, in its units."""

TABLE_02_MM = {
    ("x", "MAE"): 0.074,
    ("x", "STDE"): 0.108,
    ("x", "ME"): 0.628,
    ("y", "MAE"): 0.066,
    ("y", "STDE"): 0.076,
    ("y", "ME"): 0.435,
    ("z", "MAE"): 0.062,
    ("z", "STDE"): 0.075,
    ("z", "ME"): 0.581,
}
"""Table 2, fit of the VJM to 151 postures; ME is the largest error."""

TABLE_03_NM_PER_RAD = (50.90e3, 63.36e3, 50.34e3, 2.27e3, 8.89e3, 1.39e3)
"""Table 3, the identified stiffness of A1 to A6."""
