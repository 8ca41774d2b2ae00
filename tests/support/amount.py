"""How many inputs a generated test makes: some in CI, all in `make soak`."""

import os

THOROUGH = bool(os.environ.get("ARGOSY_THOROUGH"))


def some_of(full: int, part: int = 4) -> int:
    """How many of `full` inputs to make: one in `part`, or all where ARGOSY_THOROUGH is set."""
    return full if THOROUGH else full // part
