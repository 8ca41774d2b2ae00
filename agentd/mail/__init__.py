"""Mail of an agent: `inbox` takes each message once, `outbox` sends each once, `mail_client` joins both to a mind."""
