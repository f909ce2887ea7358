"""What knows no glider: arrays, files of settings, numerics, integrators, batches."""
