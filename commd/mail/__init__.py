"""Mail between agents, stored on disk until the receiver has it.

`service` accepts messages and gives them up, `store` writes them (`queries`, `message`), `delivery` sends each line in
order; `age_clock` counts the age of mail; `inspection` lists what waits.
"""
