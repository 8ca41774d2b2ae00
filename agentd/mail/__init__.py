"""Mail of an agent: `mail_client` joins it to a mind and receives each message once, `outbox` sends each once."""
