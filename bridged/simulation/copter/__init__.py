"""bridged.simulation.copter."""
