"""What a record tells beyond Fisher intervals, and what would tell more."""
