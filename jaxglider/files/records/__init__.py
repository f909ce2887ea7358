"""Flights written as the records of real gliders are."""
