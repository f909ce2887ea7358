"""The sea: disturbances, currents and density."""
