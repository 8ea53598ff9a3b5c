"""Runs that are killed, starved of disk, doubled or disturbed."""
