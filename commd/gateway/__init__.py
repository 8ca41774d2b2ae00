"""Gateways between networks: the gateway to the Comm nodes of the paper, and the radio model."""
