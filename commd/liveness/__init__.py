"""Who is alive: liveliness tokens, health records and their timeouts."""
