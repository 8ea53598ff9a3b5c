"""Diagnosis of what changed between two sets of photos of the same views."""
