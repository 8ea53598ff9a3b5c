"""The robot: its description (KUKA LBR iiwa, two-finger gripper, wrist camera), its kinematics, its limits."""
