"""Sensors on board: what each shows of the truth, and when."""
