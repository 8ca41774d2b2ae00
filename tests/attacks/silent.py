"""Asks for a mind and its trace by several sessions, again and again, and reads none of the answers.

python -m tests.attacks.silent ENDPOINT KEYS AGENT_KEY SESSIONS
"""

import sys
import time
from contextlib import ExitStack, suppress
from pathlib import Path

import zenoh
from zenoh.handlers import FifoChannel

from commd.bus.session import session_config, session_id
from commd.bus.tls import files_in

ROUNDS = 20.0
"""Each second."""
SECONDS = 60.0
"""After which it ends by itself."""


def main(endpoint: str, keys: str, agent: str, sessions: str) -> None:
    """Ask until the end."""
    config = session_config("client", endpoint, "silent", tls=files_in(Path(keys)))
    config.insert_json5("transport/link/tls/so_rcvbuf", "16384")  # so that little is enough to fill it
    with ExitStack() as stack:
        opened, unread = [], list[object]()
        for _ in range(int(sessions)):
            config.insert_json5("id", f'"{session_id("eye")}"')
            opened.append(stack.enter_context(zenoh.open(config)))
            # Nobody takes what comes, and Zenoh then does not read on: this is what fills the socket.
            unread.append(opened[-1].declare_subscriber("argosy/three/**", FifoChannel(1)))
        print("asking", flush=True)
        until = time.monotonic() + SECONDS
        while time.monotonic() < until:
            for session in opened:
                for key in (f"{agent}/mind", f"{agent}/trace/inputs"):
                    with suppress(zenoh.ZError):
                        unread.append(session.get(key, FifoChannel(1), timeout=SECONDS))
            time.sleep(1 / ROUNDS)


if __name__ == "__main__":
    main(*sys.argv[1:])
