"""What is said, proved and drawn of axes that are read on both sides of their gears."""
