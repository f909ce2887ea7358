"""Places on Earth, courses, and files of water that a mission names."""
