"""The bus: a typed Zenoh session.

`bus` publishes and subscribes records, and claims names; `queries` asks and serves; `raw` does the same with bytes.
`loop_dispatch` brings what arrives on Zenoh's threads to the event loop; `session` and `tls` configure and open Zenoh
sessions. `connect_diagnosis` finds why a router is not reached, `access_probe` what the router denies; `errors` has all
exceptions.
"""
