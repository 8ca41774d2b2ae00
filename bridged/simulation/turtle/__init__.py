"""bridged.simulation.turtle."""
