"""The standard library: internal actions and functions, registered when this package is imported."""

from agentd.stdlib import (  # noqa: F401 - imported for their registrations
    beliefs,
    containers,
    goals,
    lists,
    math,
    messages,
    output,
    plans,
    queries,
    random,
    strings,
    system,
    team,
    terms,
    time,
)
