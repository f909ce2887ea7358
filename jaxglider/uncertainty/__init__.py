"""Uncertain quantities, their distributions, and samplers of members."""
