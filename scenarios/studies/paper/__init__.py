"""The 2024 paper, table by table and figure by figure, on an arm of known truth.

Wu, Zhang, Gao, Deng, Li, Wang: Neural network-based transfer learning to improve
stiffness modeling of industrial robots with small experimental data sets. International
Journal of Advanced Manufacturing Technology 135 (2024) 5253-5265.

What to use when: `published_values` is what the paper prints; `experiment` carries it
out on the bench, `fresh_postures` simulates those on which is judged, `budget` is what
is spent, `cells` keep what is finished. `linear_fit`, `imitation`, `transfer` and the
tables are the paper's own questions; `few_poses`, `wrench_plan` and `floor` go past it.
`comparison` gathers methods over seeds, `discussion` tells what was found.
"""
