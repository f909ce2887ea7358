"""Set-up of a command: JAX started, options turned into values."""
