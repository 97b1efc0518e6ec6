"""A tool is as fast as it is beside what its user would reach for otherwise.

`race` lets ways of doing one task run in turn; every other file holds one task.
"""
