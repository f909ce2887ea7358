"""Checks of a closed loop before it is flown: its start, and whether it is stable."""
