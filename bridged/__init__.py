"""Robots: translation by manifest, drivers, simulated vehicles, and the bridge daemon."""
