"""A simulated ArduPilot: its state, arming checks, failsafes, missions, equipment, and its MAVLink side."""
