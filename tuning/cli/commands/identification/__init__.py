"""Commands that read flight records."""
