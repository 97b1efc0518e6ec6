"""The 2024 paper, table by table and figure by figure, on an arm whose truth is known.

Wu, Zhang, Gao, Deng, Li, Wang: Neural network-based transfer learning to improve
stiffness modeling of industrial robots with small experimental data sets. International
Journal of Advanced Manufacturing Technology 135 (2024) 5253-5265.
"""
