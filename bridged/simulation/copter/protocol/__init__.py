"""bridged.simulation.copter.protocol."""
