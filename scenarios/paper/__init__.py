"""The 2024 paper, table by table and figure by figure, on an arm whose truth is known.

Wu, Zhang, Gao, Deng, Li, Wang: Neural network-based transfer learning to improve
stiffness modeling of industrial robots with small experimental data sets. International
Journal of Advanced Manufacturing Technology 135 (2024) 5253-5265.

What to use when: `numbers` is what the paper prints; `experiment` carries it out on the
bench, `unseen` simulates the fresh postures on which is judged, `material` is what
methods may see of both, `budget` what is spent. Then a room a question: `linear_fit`,
`imitation` and `transfer` are the paper's own; `few_poses`, `wrench_plan` and `floor`
go past it. `work` keeps what is finished, `words` and `playback` tell what was found.
"""
