"""Methods are corrected by the experiment and compared: Tables 8-10, Figs 6-9.

What to use when: a `*_cell` is one piece of work, `cells` says which there are,
`answers` what is asked of every method; `comparison` gathers them over seeds, `pooled`
gives intervals, `gains` the change against the springs; `table_NN` and `pictures` show
it; `own_method` brings a researcher's own beside ours.
"""
