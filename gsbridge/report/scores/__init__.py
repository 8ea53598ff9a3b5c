"""Scores: measured figures against the floors that are asked for, and against the hidden truth. Builds on the tables."""
