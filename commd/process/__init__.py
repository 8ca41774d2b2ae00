"""Process setup of each daemon: command line, logs, state directory, systemd, event loop lag, restarts."""
