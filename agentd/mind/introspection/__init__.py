"""agentd.mind.introspection."""
