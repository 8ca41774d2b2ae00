"""The reasoner beside its peers: speed, start, memory."""
