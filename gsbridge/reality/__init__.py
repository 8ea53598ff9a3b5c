"""Reality: worlds outside the simulator, which are the embedded mirror and the logs of its robot's driver."""
