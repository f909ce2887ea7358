"""Options of each command; nothing here imports JAX."""
