"""A mechanism as it is simulated: its model, its mass properties, the compiled kernel of its joints, and replays of records."""
