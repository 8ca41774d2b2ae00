"""agentd.language.syntax_tree."""
