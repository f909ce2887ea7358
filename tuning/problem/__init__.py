"""The problem of tuning: case, gains, members, objective."""
