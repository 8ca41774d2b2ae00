"""bridged.bridge."""
