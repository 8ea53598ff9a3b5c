"""The mirror as a world to act in: its own physics and hidden parameters, and an eye-in-hand camera that is path-traced."""
