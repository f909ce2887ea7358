"""One tick, the loop over ticks, and what is measured of a run."""
