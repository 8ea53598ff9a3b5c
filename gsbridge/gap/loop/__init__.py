"""Closing the loop: from logs of failed trials to findings about the simulated arm, and from findings to its model."""
