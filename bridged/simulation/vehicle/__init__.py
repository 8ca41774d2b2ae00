"""A simulated vehicle on MAVLink: how it moves (`motion`), its autopilot (`ardupilot`), its links, faults and world.

`vehicle` is the whole, `process` and `command` run it.
"""
