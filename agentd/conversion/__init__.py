"""agentd.conversion."""
