"""The lease on a robot: one of its agents has it at a time (design section 5; docs/reference/actions.md).

Pure: who acts, what the robot shows and the time (mission seconds) go in; whether they may comes out.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence

IDLE = 10.0
"""Mission seconds without an action after which a robot that is not armed, or knows no arming, is anybody's."""


class Lease:
    """Which agent has a robot, and which one answers for it. `now` is in mission seconds."""

    def __init__(
        self,
        agents: Collection[str],
        priority: Sequence[str],
        on_change: Callable[[], None] = lambda: None,
        *,
        arms: bool = True,
    ) -> None:
        """`on_change` is called when somebody else has it, or nobody; `arms`: the robot shows whether it is in use."""
        self.answers = ""
        """The agent whose action was accepted last, until the robot is seen to be left: if it is lost, nobody flies.

        If nobody is known to have acted and the robot was in use when it was first heard: one of its agents.
        """
        self.inherited = True
        """Whether nobody has acted in this run of the bridge, and the robot may have been active ever since."""
        self.free = False
        """Whether another agent may take it from the one that answers for it."""
        self.closed = ""
        """Why no other agent may take it now although its holder is lost; empty = one may."""
        self.present: Collection[str] | None = None
        """The agents that are alive; None while nobody looks."""
        self._agents, self._priority, self._on_change, self._arms = agents, list(priority), on_change, arms
        self._since = self._acted = 0.0
        self._held = True
        """Whether the robot may have been active since it was left; before it is heard nobody knows."""

    @property
    def holder(self) -> str:
        """Who has it: others are refused. Empty if nobody has."""
        return "" if self.free else self.answers

    def restore(self, agent: str, free: bool) -> None:
        """Restore the lease of a former run of the bridge.

        An agent that has the robot no more by the mission still answers for it, until another takes it or it is lost.
        """
        self.answers, self.free = agent, free or agent not in self._agents

    def refuses(self, agent: str, doing: str, now: float) -> str:
        """Why an agent may not act, empty if it may; `doing`: the holder's running actions."""
        if agent == self.answers:
            return ""
        if self.closed:
            return self.closed
        if not self.holder or self.outranks(agent):
            return ""
        does = f"it does {doing}" if doing else "it does nothing now"
        return f"held by {self.holder} for {now - self._since:.0f} s; {does}"

    def outranks(self, agent: str) -> bool:
        """Whether an agent may take the robot from its holder."""
        rank = {name: place for place, name in enumerate(self._priority)}
        return agent in rank and rank[agent] < rank.get(self.holder, len(rank))

    def take(self, agent: str, now: float) -> None:
        """An agent's action begins: from now on it has the robot."""
        self._acted, self.inherited = now, False
        if agent != self.holder:
            self._since = now
            self._become(agent, free=False)

    def give(self, agent: str, to: str, now: float) -> str:
        """The holder hands the robot over. Returns why it cannot, empty if it has."""
        if agent != self.holder:
            return self._not_held()
        if to not in self._agents:
            return f"hand_over: {to} is no agent of this robot; its agents are {', '.join(self._agents)}"
        if self.present is not None and to not in self.present:
            return f"hand_over: agent {to} is not alive"
        self.take(to, now)
        return ""

    def release(self, agent: str) -> str:
        """Release the robot; its holder still answers for a robot in use until another agent takes it.

        Returns why it cannot, empty if it has, or if nobody held it.
        """
        if self.holder not in ("", agent):
            return self._not_held()
        self.let_go()
        return ""

    def let_go(self) -> None:
        """Let any agent take the robot."""
        if self.holder:
            self._become(self.answers, free=True)

    def step(self, *, active: bool, heard: bool, busy: bool, now: float, others: bool = False) -> None:
        """Look at the robot: the lease on one that is seen to be left ends, and one that was found in use gets an agent
        that answers for it, unless `others` (a pilot) have it.
        """
        if busy:
            self._acted = now
        idle = not busy and now - self._acted >= IDLE
        if active:
            self._held = True
            if idle and not self._arms:
                self.let_go()
            if self.inherited and heard and self._agents and not (others or self.answers):
                absent = set(self._agents).difference(self.present or ())
                self._become(min(self._agents, key=absent.__contains__), free=True)  # the first that is present
        elif heard and not busy and (idle or (self._arms and self._held)):
            self._held = self.inherited = False
            if self.answers:
                self._become("", free=False)

    def _become(self, agent: str, *, free: bool) -> None:
        self.answers, self.free = agent, free
        self._on_change()

    def _not_held(self) -> str:
        return f"held by {self.holder}" if self.holder else "nobody holds this robot"
