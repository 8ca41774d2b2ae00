"""Small parts without a bus: the mission's clock, tasks that are ended, log lines that repeat."""
