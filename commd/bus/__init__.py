"""The bus: a typed Zenoh session.

`bus` publishes, subscribes, queries and serves records; `raw` does the same with bytes; `session` and `tls` configure
Zenoh; `connect_diagnosis` says why a router is not reached, `access_probe` what the router does not let through;
`errors` has all that may be raised.
"""
