"""The autopilot as it runs on board, its guard, and a program in its place."""
