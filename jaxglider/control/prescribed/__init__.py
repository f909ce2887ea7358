"""Prescribed performance: how large an error may be, and what keeps it there."""
