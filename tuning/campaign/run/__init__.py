"""The campaign: its rows, where they are stored, who computes them."""
