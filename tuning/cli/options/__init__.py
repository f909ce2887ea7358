"""What each command is told; nothing here imports JAX."""
