"""bridged.drivers.mavlink.transport."""
