"""The 2024 paper, table by table and figure by figure, on an arm of known truth.

Wu, Zhang, Gao, Deng, Li, Wang: Neural network-based transfer learning to improve
stiffness modeling of industrial robots with small experimental data sets. International
Journal of Advanced Manufacturing Technology 135 (2024) 5253-5265.

What to use when: `published_values` are the numbers of the paper; `experiment` carries
it out on the bench and simulates the poses for evaluation, `budget` holds steps, seeds
and poses, `cells` keep finished work. `linear_fit`, `imitation`, `transfer`,
`fine_tuning` and `table_10` are the paper's own questions; `few_poses`, `wrench_plan`
and `floor` go beyond it. `comparison` compares methods over seeds, `discussion` puts
the results into words, `playback` shows them.
"""
