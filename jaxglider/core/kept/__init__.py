"""Programs kept on disk, and the digests by which they are found again."""
