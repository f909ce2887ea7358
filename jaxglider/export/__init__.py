"""The tuned autopilot as C99, generated from the trace of what was tuned."""
