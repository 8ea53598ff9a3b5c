"""What diagnoses of joints, thrown bodies and pictures have in common."""
