"""The MAVLink driver: `transport` (links, framing, signing), `vehicle` (state, modes, commands), `actions`, `manifest`.

`driver` is what the bridge calls, `session` one conversation with a vehicle, `control_authority` who flies it.
"""
