"""Mail between agents, stored on disk until the receiver has it.

`service` accepts messages, `store` writes them (`schema`, `queries`, `message`, `sqlite_file`, `page_checksums`),
`delivery` sends each line in order by `transport`; `dead_letters` gives up; `age_clock` counts the age of mail;
`inspection` lists what waits.
"""
