"""Mail of an agent: `mail_client` joins it to a mind and receives each message once, `neighbours` is mail within the
daemon, `outbox` sends the rest, each message once."""
