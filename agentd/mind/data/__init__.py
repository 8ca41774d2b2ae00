"""agentd.mind.data."""
