"""What differs between members, how it is distributed, where members lie."""
