"""Trust in a gradient."""
