"""Actions on a MAVLink vehicle: procedures, missions, parameters, setpoints, and the waits that confirm them.

`context` is what a procedure works with, `flight` has take-off, go-to, landing; `confirmation` waits for the vehicle's
state; `mission_*` upload, download and fly missions.
"""
