"""The simulated world: PyBullet physics driven by torque, described whole by one model file."""
