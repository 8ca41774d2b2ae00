"""agentd.standalone."""
