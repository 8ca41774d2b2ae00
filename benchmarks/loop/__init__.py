"""The decision loop through the real daemons: its latency, where the time goes, and how many percepts it takes."""
