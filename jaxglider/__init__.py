"""Differentiable simulation, control and gain tuning of underwater gliders."""
