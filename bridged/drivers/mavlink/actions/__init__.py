"""bridged.drivers.mavlink.actions."""
