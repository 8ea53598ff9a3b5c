"""The tasks: where objects start, and what counts as reward, success and failure. Pure functions that know no simulator."""
