"""Output for people: progress, tables, statistics and exit codes."""
