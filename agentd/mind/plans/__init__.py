"""agentd.mind.plans."""
