"""agentd.replay."""
