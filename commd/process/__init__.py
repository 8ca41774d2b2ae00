"""Process setup of each daemon: command line, logs, state and its files, systemd, event loop lag, restarts."""
