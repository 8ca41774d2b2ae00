"""How simulated vehicles move: point masses that follow shaped targets, and the tasks that they are given."""
