"""The mirror: an embedded stand-in for reality, with its own shapes, textures, light and camera; its films are made here."""
