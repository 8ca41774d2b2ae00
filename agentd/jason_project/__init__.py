"""Project files of Jason (``.mas2j``): read, and made into the agents that ``agentd run`` runs."""
