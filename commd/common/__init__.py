"""Small parts without a bus: the mission's clock, the loop's wake-ups, tasks and timers, log lines that repeat."""
