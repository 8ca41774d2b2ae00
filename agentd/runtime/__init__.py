"""agentd.runtime."""
