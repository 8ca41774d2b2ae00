"""The MAVLink driver: `transport` (links, framing, signing), `vehicle` (state, modes, commands), `actions`, `manifest`.

`driver` is what the bridge calls: a `session` with a vehicle on a link. `control_authority` judges who flies it.
"""
