"""agentd.mind.beliefs."""
