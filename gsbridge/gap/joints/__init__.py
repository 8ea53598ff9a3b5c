"""Gap diagnosis for driven joints: find, from logs and a model of a mechanism, the effects that the model lacks."""
