"""Tells a scout of the people whom a detector sees: what a camera program of a search and rescue has to publish.

    my_detector | python camera.py uav1/victim tcp/127.0.0.1:7447

The detector prints a line `NUMBER LATITUDE LONGITUDE` (degrees) for somebody whom it sees, and the same number for the
same person. Each is put on the key once a second for ten seconds, so that a restart of the router hides nobody.
"""

import json
import sys
import threading
import time

import zenoh

REMEMBERED = 10.0
"""Seconds for which somebody is told after the last line."""


def tell(key: str, router: str) -> None:
    """Publish what comes on standard input until it ends."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([router]))
    seen: dict[int, tuple[float, str]] = {}
    reader = threading.Thread(target=read, args=(seen,))
    with zenoh.open(config) as session:
        publisher = session.declare_publisher(key, encoding=zenoh.Encoding.APPLICATION_JSON)
        reader.start()
        while reader.is_alive() or any(time.monotonic() - at < REMEMBERED for at, _ in seen.values()):
            for at, record in list(seen.values()):
                if time.monotonic() - at < REMEMBERED:
                    publisher.put(record)
            time.sleep(1.0)


def read(seen: dict[int, tuple[float, str]]) -> None:
    """Read the detector's lines."""
    for line in sys.stdin:
        number, latitude, longitude = line.split()
        record = json.dumps({"id": int(number), "lat": float(latitude), "lon": float(longitude)})
        seen[int(number)] = time.monotonic(), record


tell(*sys.argv[1:])
