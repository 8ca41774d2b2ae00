"""agentd.extensions."""
