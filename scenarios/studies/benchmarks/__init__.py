"""Speed of the bench and the methods, beside what a user would use otherwise.

`race` lets ways of doing one task run in turn; every other file holds one task.
"""
