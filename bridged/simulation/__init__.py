"""Simulated vehicles: they ship with the product, and they are its test doubles."""
