"""Steady motion, and the linear model around it."""
