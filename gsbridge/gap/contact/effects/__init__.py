"""Effects of thrown and sliding bodies, one per file."""
