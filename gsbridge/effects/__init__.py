"""What a model may lack: what an effect is, the effects of joints, bodies and images, and the check of a model's list of them.

Every effect is one file of `joints`, `bodies` or `images`, named in the list of its package. It says what it is called, what
its parameters mean, and what it changes in a setup; whatever simulates offers a setup that such changes can be made to.
"""
