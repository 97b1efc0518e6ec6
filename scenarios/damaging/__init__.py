"""A good recording can be spoiled in many ways, in its files or in what they mean."""
