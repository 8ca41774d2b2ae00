"""Flights by independent clients, each a process of its own."""
