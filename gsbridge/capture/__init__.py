"""Capture: sources of photos, keyframes, and the printable board."""
