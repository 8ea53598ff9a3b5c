"""The mirror as a world in which a robot acts: its own physics, hidden parameters and a path-traced eye-in-hand camera."""
