"""Reports: command line, pages, figures, data files, summaries, playbacks.

What to use when: `command_line` runs a command with its flags; `route` diagnoses and
writes the answer, whole or not at all (`data_files`); `page` writes report.md and
report.html from the same blocks, `sections` make those of each engine; `summary` is a
diagnosis in sentences, `error_budget` its shares by place and the arm drawn by them;
`figures` and `playback` show it; `data_files` writes tidy csv files, `style` holds what
all figures share.
"""
