"""What follows from the rows: summaries, sensitivities, requirements."""
