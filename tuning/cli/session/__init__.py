"""What a command needs before it works: JAX set up, options turned into values."""
