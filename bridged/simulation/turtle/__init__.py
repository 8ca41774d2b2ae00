"""A simulated turtle on Zenoh keys, like the one of turtlesim."""
