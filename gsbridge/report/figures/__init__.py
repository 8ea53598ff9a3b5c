"""Figures, films of trials, and the rows measured for them. Builds on the tables."""
