"""bridged.drivers.mavlink.vehicle."""
