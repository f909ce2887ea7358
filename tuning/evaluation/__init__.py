"""Results: runs, held-out verdicts and their reports."""
