"""Formats of records: those that users bring, and the one in which the workflow keeps them."""
