"""Tuning of controller gains through the rollout, and the command line."""
