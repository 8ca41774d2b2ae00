"""The MAVLink side of the simulated copter: commands, parameters, missions, telemetry, signing, bad links."""
