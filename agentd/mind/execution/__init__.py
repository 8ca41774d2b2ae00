"""agentd.mind.execution."""
