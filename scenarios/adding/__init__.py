"""Effects of known size are added to real readings: real noise, known truth."""
