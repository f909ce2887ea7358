"""Least squares, what they tell of each number, and what would tell more."""
