"""agentd.language.errors."""
