"""A vehicle from its own flight record: what is read, fitted, and reported."""
