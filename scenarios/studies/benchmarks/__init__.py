"""Speed of the bench and the methods, beside what a user would use otherwise.

`race` runs several ways of doing one task in turn; every other file holds tasks.
"""
