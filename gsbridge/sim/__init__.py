"""The simulated world: PyBullet physics driven by torque, described completely by one model file."""
