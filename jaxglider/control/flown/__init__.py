"""The laws that gliders at sea are steered by, as their vendors describe them."""
