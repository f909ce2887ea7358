"""The free numbers: bijections, coordinates, and a start inside the sets."""
