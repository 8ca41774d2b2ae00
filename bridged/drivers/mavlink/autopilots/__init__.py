"""How each autopilot is commanded: `autopilot.py` is the interface of `ardupilot.py` and `px4.py`.

Modes, as data, are in `vehicle/flight_modes.py`. Procedures (`actions/`) know no autopilot by name.
"""
