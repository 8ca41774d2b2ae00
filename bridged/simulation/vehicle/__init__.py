"""A simulated vehicle on MAVLink: its motion (`motion`), autopilot (`ardupilot`, `px4`), links, faults and world.

`vehicle` is the whole, `kinds` lists those that there are, `process` and `command` run one. What both autopilots have
in common is here: `autopilot`, `messages`, `command_messages`, `mission_protocol`, `parameters`, `telemetry`.
"""
