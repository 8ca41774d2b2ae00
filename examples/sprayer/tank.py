"""The tank of the sprayer: any program that puts JSON on Zenoh keys and answers there is a part of a robot.

python tank.py [ENDPOINT]
"""

import contextlib
import json
import sys
import time

import zenoh

PREFIX = "uav1/tank"
litres = 5.0


def pump(query: zenoh.Query) -> None:
    """Answers {"litres": L}: done, or why not."""
    global litres
    with query:
        wanted = json.loads(query.payload.to_bytes())["litres"]
        enough = wanted <= litres
        if enough:
            litres -= wanted
        reason = f"{litres:g} l left, {wanted:g} l wanted"
        query.reply(f"{PREFIX}/pump", json.dumps({"success": enough, "message": reason}))


endpoint = sys.argv[1] if len(sys.argv) > 1 else "tcp/127.0.0.1:7447"
retry = "retry: {period_init_ms: 200, period_max_ms: 200}"
connect = f'{{endpoints: ["{endpoint}"], timeout_ms: -1, {retry}}}'  # waits for the router as long as it takes
print(f"the tank waits for a router at {endpoint}", flush=True)
config = zenoh.Config.from_json5(f'{{mode: "client", connect: {connect}}}')
with contextlib.suppress(KeyboardInterrupt), zenoh.open(config) as session:
    session.declare_queryable(f"{PREFIX}/pump", pump)
    while True:
        session.put(f"{PREFIX}/level", json.dumps({"litres": litres}))
        time.sleep(0.2)
