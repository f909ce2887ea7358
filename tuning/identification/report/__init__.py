"""Results of a fit: scores on held-out dives, report, figures, and files."""
