"""The bridge of one robot: between agents on the bus and a driver.

`bridge` composes. `action_server` runs actions (`running_action`, `action_status`, `action_log` on disk), `lease` and
`agent_monitor` say who may act, `safety_orders`, `pause` and `idle_monitor` what happens above agents;
`composite_driver` makes one driver of several, `driver_supervisor` restarts it; `percepts` publishes percepts by
`translation`.
"""
