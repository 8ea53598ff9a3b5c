"""Effects that a simulation may lack: the base class, the effects of joints, bodies and images, and the check of model files.

Each effect is one file in `joints`, `bodies` or `images` and is listed in the `__init__` of that package. An effect states its
name, the meaning of its parameters, and what it changes in a setup; every simulator offers a setup that effects can change.
"""
