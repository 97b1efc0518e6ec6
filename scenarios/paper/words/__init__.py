"""What the study found, in sentences: first a paragraph, last what explains it."""
