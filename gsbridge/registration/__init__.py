"""Registration: where the table stands before the robot and where the camera sits on the flange."""
