"""The model of a fleet that `argosy run`, `ui`, `watch` and `plot` show.

`model` takes records; `observer` and `link` fill it from the bus. `members`, `robots`, `actions`, `places`,
`message_log` and `timeline` are its parts; `fleet_status` (also of `argosy status`), `lives` and `mission_clock` judge
who is there, which run it is and what time it is; `activity` says what an agent does.
"""
