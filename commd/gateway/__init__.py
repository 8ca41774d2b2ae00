"""Gateways between networks: the gateway daemon, the paper's Comm node, and the radio model."""
