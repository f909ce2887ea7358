"""Missions, gains, uncertainty and results on disk."""
