"""Long work is cut into cells that are kept, worked at once, and shown on their way."""
