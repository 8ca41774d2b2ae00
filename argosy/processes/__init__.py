"""Processes of a mission on this machine: which there are, how they start, restart and end."""
