"""bridged.drivers.mavlink.manifest."""
