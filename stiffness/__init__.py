"""Everything that can be claimed: methods that predict, and the diagnosis."""
