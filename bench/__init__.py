"""Everything that can be true: the arm as it really is, and what measures it."""
