"""Effects of driven joints, one per file."""
