"""Simulation of a mechanism: its model, its mass properties, the compiled kernel of its joints, and replays of records."""
