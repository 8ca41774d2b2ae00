"""Parameters of a query for a mind: `{agent}/mind?plans=true;last=200;about=go`."""

from __future__ import annotations

import re
from typing import Final

from msgspec import Struct
from msgspec.structs import replace

LAST_DECISIONS: Final = 20
"""Number of last decisions and failures in a view of a mind, unless the query asks for more."""
MOST_DECISIONS: Final = 200
MOST_BELIEFS: Final = 500

_EXPECTED: Final = "expected plans=true, last=N, beliefs=N or about=NAME"
_NAME: Final = re.compile(r"~?[\w.:]+(/\d+)?")


class BadParameter(ValueError):
    """An invalid parameter of a query for a mind; the text has the parameter and what was expected."""


class Look(Struct, frozen=True):
    """Parameters of a query for a mind."""

    plans: bool = False
    last: int = LAST_DECISIONS
    """Number of decisions and failures."""
    beliefs: int = MOST_BELIEFS
    """Number of beliefs at most."""
    about: str = ""
    """A functor: only beliefs, events, plans and decisions of this name."""

    @staticmethod
    def of(parameters: dict[str, str]) -> Look:
        """Read the parameters of a query. Raises BadParameter."""
        look = Look()
        for name, value in parameters.items():
            match name:
                case "plans" if value in ("true", "false", ""):
                    look = replace(look, plans=value != "false")
                case "last":
                    look = replace(look, last=_number(name, value, MOST_DECISIONS))
                case "beliefs":
                    look = replace(look, beliefs=_number(name, value, MOST_BELIEFS))
                case "about" if _NAME.fullmatch(value):
                    look = replace(look, about=value.partition("/")[0])
                case _:
                    parameter = f"{name}={value}" if value else name
                    raise BadParameter(f"{parameter[:100]}: {_EXPECTED}")
        return look


EVERYTHING: Final = Look()


def _number(name: str, value: str, most: int) -> int:
    if value.isdecimal() and len(value) < 10 and int(value) <= most:
        return int(value)
    raise BadParameter(f"{name}={value[:20]}: expected a number from 0 to {most}")
