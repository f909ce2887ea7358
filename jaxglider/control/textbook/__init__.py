"""The laws of the textbooks: what a paper on a new one is asked to beat."""
