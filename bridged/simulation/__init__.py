"""Simulated vehicles: a copter on MAVLink, a turtle on Zenoh. `command` starts one."""
