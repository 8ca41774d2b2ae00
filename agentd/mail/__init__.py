"""agentd.mail."""
