"""Open a session at an endpoint as whoever runs this: prints `in`, or `out` if the router cannot be reached."""

import sys

import zenoh

from commd.bus.session import session_config


def main(endpoint: str) -> None:
    """Knock once."""
    try:
        with zenoh.open(session_config("client", endpoint, "knocks")) as session:
            print("in" if session.info.routers_zid() else "no router")
    except zenoh.ZError:
        print("out")


if __name__ == "__main__":
    main(sys.argv[1])
