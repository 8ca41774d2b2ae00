"""What each daemon is as a process: command line, logs, state directory, systemd, event loop lag, restarts."""
