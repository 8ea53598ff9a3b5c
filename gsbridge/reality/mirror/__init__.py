"""The mirror: an embedded stand-in for reality, with its own shapes, textures, light, camera and (later) physics."""
