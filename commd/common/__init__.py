"""Small parts without a bus: the mission's clock, the loop's wake-ups, tasks that are ended, log lines that repeat."""
