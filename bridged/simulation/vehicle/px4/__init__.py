"""A simulated PX4: its modes, commander, navigator, failsafes, parameters, and its MAVLink side."""
