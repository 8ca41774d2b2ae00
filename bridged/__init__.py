"""What the robot does: translation by manifest, drivers, simulated vehicles, and the bridge daemon."""
