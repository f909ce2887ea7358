"""The Python API: tune, sweep and check_gradients, each a function and its result."""
