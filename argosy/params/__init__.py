"""Parameters of vehicles, in files and in the vehicle."""
