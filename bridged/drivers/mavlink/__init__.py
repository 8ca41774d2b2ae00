"""The MAVLink driver: addresses, wire framing, links, and what a vehicle says and does over them."""
