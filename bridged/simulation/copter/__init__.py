"""A simulated ArduCopter: `dynamics` and `flight_control`, arming checks, failsafes, battery, equipment, faults.

`copter` is the vehicle, `protocol` its MAVLink side, `process` and `command` run it.
"""
