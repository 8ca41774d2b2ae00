"""The bridge of one robot: between agents on the bus and a driver.

`bridge` composes, `robot_setup` reads what it needs first, `bus_endpoints` connects it to the bus. `action_server` runs
actions (`running_action`, on disk `action_log`); `lease` and `agent_monitor` say who may act, `safety_orders` what
happens above agents. `composite_driver` makes one driver of several and runs them again; `percepts`
publishes percepts of their readings; `live_manifest` changes the manifest while the robot works.
"""
