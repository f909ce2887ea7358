"""The compiler from a trace to C99."""
