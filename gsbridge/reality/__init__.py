"""Reality: the worlds that stand outside the simulator, the embedded mirror and the robot's own logs."""
