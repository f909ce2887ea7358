"""Exit codes of the commands; nothing here imports JAX."""

OK = 0
"""All well."""
RUN_FAILED = 1
"""A run failed."""
USAGE = 2
"""The command, an option or a file cannot be used."""
VIOLATED = 3
"""A stated requirement is violated."""
INTERRUPTED = 130
"""Interrupted; what is finished is kept."""
