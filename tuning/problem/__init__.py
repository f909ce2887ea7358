"""What is tuned: case, gains, members, objective."""
