"""agentd.language.parser."""
