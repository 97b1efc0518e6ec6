"""What the floor is: one who knows the truth's form, and the way to it."""
