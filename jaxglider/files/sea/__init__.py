"""What a mission takes from the sea: places on Earth, courses, and files of water."""
