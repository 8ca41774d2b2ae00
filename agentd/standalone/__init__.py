"""`agentd run`: agents in one process, without a bus."""
