"""The 2024 paper, table by table and figure by figure, on an arm of known truth.

Wu, Zhang, Gao, Deng, Li, Wang: Neural network-based transfer learning to improve
stiffness modeling of industrial robots with small experimental data sets. International
Journal of Advanced Manufacturing Technology 135 (2024) 5253-5265.

The tables below are the numbers that it prints, in its units.

What to use when: `experiment` carries it out on the bench and simulates the poses for
evaluation, `budget` holds steps, seeds and poses, `cells` keep finished work.
`linear_fit`, `imitation`, `transfer`, `fine_tuning` and `table_10` are the paper's own
questions; `few_poses`, `wrench_plan` and `floor` go beyond it. `comparison` compares
methods over seeds, `discussion` puts the results into words, `playback` shows them.
"""

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

TABLE_06_MM = {
    2: ((0.2469, 0.1365), (0.2501, 0.1382)),
    3: ((0.2164, 0.1223), (0.2186, 0.1230)),
    4: ((0.2070, 0.1178), (0.2090, 0.1195)),
    5: ((0.2349, 0.1213), (0.2375, 0.1229)),
    6: ((0.2381, 0.1286), (0.2399, 0.1318)),
}
"""Table 6: hidden layers of 100; (MAE, STDE) on training, then on test rows."""

TABLE_07_MM = {
    "sigmoid": ((0.9656, 0.5924), (0.9692, 0.5936)),
    "tanh": ((0.3353, 0.1959), (0.3349, 0.1944)),
    "relu": ((0.1180, 0.0694), (0.1199, 0.0709)),
}
"""Table 7: activation of four hidden layers of 380; as above."""

TABLE_09_MM = {
    "last": ((0.0746, 0.0584), (0.1997, 0.1471)),
    "best": ((0.0792, 0.0375), (0.1604, 0.1295)),
}
"""Table 9: "normal" keeps the last epoch, "optimized" the best; (MAE, STDE) on training
poses, then on the poses that choose the epoch."""

TABLE_10_MM = {
    "vjm": {
        "x": {"MAE": 0.0777, "STDE": 0.1123, "ME": 0.6500},
        "y": {"MAE": 0.0657, "STDE": 0.0762, "ME": 0.4300},
        "z": {"MAE": 0.0595, "STDE": 0.0717, "ME": 0.5700},
    },
    "ft_mlp": {
        "x": {"MAE": 0.0451, "STDE": 0.0766, "ME": 0.6000},
        "y": {"MAE": 0.0374, "STDE": 0.0463, "ME": 0.3400},
        "z": {"MAE": 0.0447, "STDE": 0.0615, "ME": 0.3200},
    },
    "dt_cnn": {
        "x": {"MAE": 0.0729, "STDE": 0.0875, "ME": 0.7700},
        "y": {"MAE": 0.0765, "STDE": 0.0928, "ME": 0.5200},
        "z": {"MAE": 0.0628, "STDE": 0.0832, "ME": 0.6200},
    },
}
"""Table 10, by method, direction and measure."""
