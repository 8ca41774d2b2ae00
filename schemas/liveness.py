"""When a daemon, agent, robot, run or action counts as late, silent or lost: one table for all daemons and commands.

All values are wall seconds. Daemons judge each other in `commd.liveness`: `presence` by liveliness tokens and health
records, `bridge_presence` by both of one robot's bridge. `argosy.fleet_model` judges for operators, and who follows a
run or an action compares its age with a value of this table. Vehicles and links have limits of their own, in manifests.
"""

from __future__ import annotations

# How often proofs of liveness are published (`schemas.wire.keys.CHANNELS` has the rates of all records).
HEALTH_EVERY = 1.0
"""The health record of each daemon."""
STATUS_EVERY = 1.0
"""The `running` status of an action, by which its bridge reports that it is still carried out."""
MIND_EVERY = 2.0
"""The request for each mind's summary by an observer."""

# Silent: the token is there, the records are not.
SILENT_AFTER = 5.0
"""A daemon, mind or run that has published nothing for this long is silent: it hangs, or is cut off."""
HUNG_AFTER = 15.0
"""A daemon that has been silent, although its board is heard, or stopped for this long is killed by its run."""
FIRST_HEALTH = 30.0
"""Time for the first health record after the token appeared: a daemon may have much to read from its disk."""
STALE_AFTER = 3 * HEALTH_EVERY
"""The state of a vehicle, or of a mind that is looked at, is shown as old after this."""
MIND_STALE_AFTER = 3 * MIND_EVERY
"""A summary of a mind is shown as old after this."""
LAG_LATE = 0.5
"""An event loop that is behind by this much is late."""

# Lost: the token is missing.
BRIDGE_GRACE = 0.3
"""Time for which the token of a robot's bridge must be missing while the router answers."""
AGENT_GRACE = 1.0
"""The same for an agent: a robot is held, or brought home, when its agent is lost."""
ROUTER_GRACE = 5.0
"""Time to come back after a router went or came: each daemon reconnects at its own pace, and a restart is no death."""
BUS_GRACE = 5.0
"""Time without any router after which everybody else counts as lost."""
FORGOTTEN_AFTER = 60.0
"""A directory forgets an agent that has been absent for this long, unless it is declared as permanent."""

# Actions, by their statuses.
ACTION_ASKED_AGAIN = 3 * STATUS_EVERY
"""Without a status for this long the action is asked for again: its query may be broken and never end."""
ACTION_SILENT = 10.0
"""Without a status for this long a command that follows an action stops waiting for it."""
ACTION_GIVEN_UP = 30.0
"""Without a status for this long an observer takes the action for ended, its end unknown."""
