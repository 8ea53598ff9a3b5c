"""The gap of driven joints: from logs and a model of a mechanism to the effects that the model lacks."""
