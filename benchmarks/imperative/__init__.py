"""The missions `single_uav` and `search_and_rescue` flown by imperative Python programs on `commd.client`.

They do what the AgentSpeak programs do: the same strategy, the same messages, the same answer to what fails. What would
make them longer than they have to be is left out:

- What agents get without a line of their own and would need code here. Started again, a program begins anew, where an
  agent goes on from its checkpoint; and it ends when `commd` stays away for longer than the patience of `join`, where
  the mail of an agent waits in its own outbox.
- Annotations of types, which AgentSpeak has neither.
- How a program is started and gets its values (`__main__.py`), which for agents is the mission's and the daemon's.
"""
