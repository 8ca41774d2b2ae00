"""What a manifest may say of a MAVLink vehicle: actions, message fields, and their validation."""
