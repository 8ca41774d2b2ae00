"""One vehicle as its messages show it: state, flight modes, streams, texts, failsafes, and commands to it."""
