"""What people read: progress, tables, statistics and exit codes."""
