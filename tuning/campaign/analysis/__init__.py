"""Conclusions from the rows: summaries, sensitivities, requirements."""
