"""Registration: finds the pose of the table in the robot's base frame and the pose of the camera on the flange."""
