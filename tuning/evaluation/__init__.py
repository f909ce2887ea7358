"""What came of it: runs, held-out verdicts and their reports."""
