"""Thrown and sliding bodies: which effect of contact, of the body or of its tracking a simulation lacks."""
