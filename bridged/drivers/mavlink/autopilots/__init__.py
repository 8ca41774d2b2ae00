"""How each autopilot is commanded: `autopilot.py` is ArduPilot, and what `px4.py` does otherwise is there.

Modes, as data, are in `vehicle/flight_modes.py`. Procedures (`actions/`) know no autopilot by name.
"""
