"""Mail between agents, stored on disk until the receiver has it.

`service` takes messages, `store` keeps them (`schema`, `queries`, `sqlite_file`, `page_checksums`), `delivery` sends
each mailbox's messages in order by `transport`; `dead_letters` are those given up; `inspection` shows what waits.
"""
