"""Tables of yo missions, and the missions that come with the package."""
