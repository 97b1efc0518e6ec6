"""Reports: command line, pages, figures, data files, summaries, playbacks.

What to use when: `route` diagnoses and writes the answer; `page` writes report.md and
report.html from the same blocks, `sections` hold those of each engine; `data_files`
writes tidy csv files, `style` gives every figure the same look.
"""
