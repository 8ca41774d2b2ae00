"""How daemons start, and what they hold at rest."""
