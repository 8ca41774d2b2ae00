"""Links to MAVLink vehicles: sockets and serial lines, framing, signing, forwarding to ground stations."""
