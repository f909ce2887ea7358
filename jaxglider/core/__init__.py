"""Foundations that know no glider: arrays, TOML, numerics, integrators, batches."""
