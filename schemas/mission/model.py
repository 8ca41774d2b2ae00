"""The mission file (design section 11): which agents run which programs on which robots, and when it is done."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

import msgspec

from schemas.files.findings import Finding, Findings, did_you_mean, near_miss
from schemas.files.shipped_files import mission_file, shipped_names
from schemas.files.text_files import other_kind, read_text
from schemas.files.units import LINK_FORMS, Distance, Duration, check_endpoint, decode_hook, host_and_port
from schemas.files.yaml_positions import Positions, Steps, convert, read_yaml
from schemas.wire.keys import Sight, check_name
from schemas.wire.records import Order

THIS_MACHINE = "local"
"""Name of the one board of a mission that declares none."""
DEFAULT_ROUTER = "tcp/127.0.0.1:7447"
"""Zenoh's own default port, on loopback only: any Zenoh CLI finds it."""
DEFAULT_PORT = 7447
RESERVED = frozenset(("df", "mail", "percept", "self"))
"""Reserved names: senders of notices, and sources of beliefs that no agent has sent."""
LEAST_SILENCE = Duration(3)
"""The shortest `agent_silence`: two health records of an agent may be lost or late."""

ANYBODY = "*"
"""In `accepts`: every sender that is not named."""
ALL = "all"
"""In `accepts`: every performative."""
PERFORMATIVES = frozenset(
    (
        *("tell", "untell", "achieve", "unachieve", "signal"),
        *("askOne", "askIf", "askAll", "askHow", "tellHow", "untellHow"),
    )
)
"""Performatives that agents handle without a plan of their own."""

NO_STEPS = "none"
"""The value of `on_idle` that switches it off."""

Accepted: TypeAlias = tuple[str, ...] | Literal["all"]
"""Performatives."""
Latitude = Annotated[float, msgspec.Meta(ge=-90, le=90)]
Longitude = Annotated[float, msgspec.Meta(ge=-180, le=180)]
Positive = Annotated[float, msgspec.Meta(gt=0)]
Home = Annotated[
    tuple[Latitude, Longitude, float],
    msgspec.Meta(description="[latitude -90 to 90, longitude -180 to 180, metres above mean sea level]"),
]
LinkText = Annotated[str, msgspec.Meta(description=f"a link such as {LINK_FORMS}")]


class FileModel(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A part of a file that people write: unknown fields are refused."""


class Board(FileModel, frozen=True, kw_only=True):
    """A computer of the fleet."""

    address: str = ""
    """`HOST` or `HOST:PORT` at which the routers of the other boards reach its own; none = the router listens to this
    machine alone."""

    @property
    def host(self) -> str:
        """The host of the address, an IPv6 one without brackets; empty without an address."""
        return host_and_port(self.address, DEFAULT_PORT)[0].strip("[]") if self.address else ""


class Agent(FileModel, frozen=True, kw_only=True):
    """An agent and its program."""

    program: str
    """Path of the .asl file, relative to the mission file."""
    robot: str | None = None
    board: str = THIS_MACHINE
    beliefs: tuple[str, ...] = ()
    """Initial beliefs, in the syntax of programs."""
    goals: tuple[str, ...] = ()
    """Goals to achieve at the start, besides those of the program."""
    presence: bool = False
    on_restart: str = "resume"
    """resume, fresh, or `goal(g)`."""
    accepts: dict[str, Accepted] = {}
    """Performatives that it accepts, by sender; `*` = every agent and program that is not named. An entry replaces
    the default rule for its sender (docs/guides/security.md)."""


class Failsafe(FileModel, frozen=True, kw_only=True):
    """Whose heartbeats the vehicle's own ground-station failsafe watches."""

    gcs: Literal["bridge", "human", "none"] | None = None
    """None = not declared; `none` = nobody's, on purpose."""

    @property
    def watches(self) -> bool:
        """Whether the mission relies on it."""
        return self.gcs in ("bridge", "human")


class Limits(FileModel, frozen=True, kw_only=True):
    """Limits that the bridge enforces for every action."""

    altitude: Positive | None = None
    """Metres above home, more than 0; none = no limit."""
    radius: Positive | None = None
    """Metres around home, more than 0; none = no limit."""


class Ids(FileModel, frozen=True, kw_only=True):
    """MAVLink ids of the bridge, 1 to 255; none = those that the vehicle's failsafe expects."""

    system: Annotated[int, msgspec.Meta(ge=1, le=255)] | None = None
    component: Annotated[int, msgspec.Meta(ge=1, le=255)] | None = None


class Signing(FileModel, frozen=True, kw_only=True):
    """MAVLink 2 signing: the bridge signs its packets and rejects unsigned ones."""

    passphrase_file: str
    """Path of a file whose first line is the passphrase, relative to the mission file; readable by its owner only."""


class Lease(FileModel, frozen=True, kw_only=True):
    """Which agent has a robot that several agents share, one at a time."""

    priority: tuple[str, ...] = ()
    """Agents, the highest priority first. Each may take the robot from those after it and from those not listed."""


class Simulate(FileModel, frozen=True, kw_only=True):
    """The simulated counterpart of a robot; without any field the robot's driver simulates itself."""

    vehicle: str = ""
    """Vehicle of `bridged simulate`: `copter`, `plane`, `rover` or `turtle`."""
    autopilot: Literal["ardupilot", "px4"] = "ardupilot"
    """The autopilot of a copter, plane or rover."""
    home: Home | None = None
    """Degrees, degrees, metres above mean sea level; for vehicles."""
    board: str | None = None
    """The machine that the simulation runs on, as `argosy simulate --board` names it; none = the robot's board."""
    parameters: dict[str, float] = {}
    """Parameters of its autopilot, such as `{FS_GCS_ENABLE: 1}`."""
    battery: Duration | None = None
    """Flight time of a full battery; none = it never runs down, as in the recording."""
    recharge: Duration | None = None
    """Mission seconds to recharge an empty battery at home with the motors off; none = 120."""
    camera: Distance | None = None
    """Metres over ground within which it sees the victims of the mission's world; none = it has no camera."""
    faults: tuple[str, ...] = ()
    """Faults of the vehicle and its link, such as `loss=0.2` (docs/guides/simulation.md)."""

    @property
    def process(self) -> str:
        """The vehicle to simulate in a process, a copter if only `home` is given; empty = no process is needed."""
        return self.vehicle or ("copter" if self.home is not None else "")


class Robot(FileModel, frozen=True, kw_only=True):
    """A robot, its manifest and how to reach it."""

    manifest: str | tuple[str, str]
    """The name of a shipped manifest, a path relative to the mission file, or the paper's INI pair."""
    link: LinkText = ""
    """For MAVLink: `udpin:HOST:PORT`, `udpout:`, `tcp:`, `tcpin:` or `serial:DEVICE:BAUD`."""
    prefix: str = ""
    """For robots on Zenoh: the prefix of each key in the manifest."""
    board: str = THIS_MACHINE
    sysid: Annotated[int, msgspec.Meta(ge=1, le=255)] = 1
    """MAVLink system id of the vehicle."""
    ids: Ids = Ids()
    signing: Signing | None = None
    forward: str | tuple[str, ...] = ()
    """Links to ground stations that may watch and command the vehicle, such as `udpout:127.0.0.1:14551`."""
    lease: Lease = Lease()
    failsafe: Failsafe = Failsafe()
    limits: Limits = Limits()
    on_agent_loss: tuple[str, ...] = ("hold 5s", "rtl")
    agent_silence: Duration = Duration(5)
    """Wall seconds without a health record after which a present agent counts as lost (it hangs); at least 3."""
    on_idle: tuple[str, ...] | Literal["none"] = ("rtl",)
    """Steps while the robot is in the air and its present agents have no intention; `none` = only the alarm."""
    idle_after: Duration = Duration(10)
    """Mission seconds until `on_idle` begins; also the time for an agent that was lost and is back to take control."""
    on_shutdown: Order = "rtl"
    simulate: Simulate | None = None

    def source(self, driver: str, source: str) -> str:
        """Return a source of a percept as a driver knows it: on Zenoh, the key with the robot's prefix."""
        return f"{self.prefix}/{source}" if driver == "zenoh" and self.prefix else source


class Router(FileModel, frozen=True, kw_only=True):
    """The board's Zenoh router."""

    endpoint: str = DEFAULT_ROUTER
    external: bool = False
    """True: a `zenohd` that somebody else runs at the endpoint; commd is then its client."""


class Client(FileModel, frozen=True, kw_only=True):
    """A program that joins the team by `commd.client`: it sends and receives mail as an agent does."""

    board: str = THIS_MACHINE
    """The board whose commd stores its mail."""
    robot: str | None = None
    """The robot that it perceives and controls, as an agent does."""


class Gateway(FileModel, frozen=True, kw_only=True):
    """The gateway to Comm nodes of the paper and other programs that use its datagrams,
    `<id,sender,itlforce,receiver,data>` by UDP."""

    board: str = THIS_MACHINE
    """The board whose commd exchanges datagrams with them."""
    listen: str
    """`HOST:PORT` at which their datagrams are received."""
    nodes: dict[str, str]
    """The agents behind it by name, each with the `HOST:PORT` of its node."""


class MailRules(FileModel, frozen=True, kw_only=True):
    """How boards store mail."""

    ttl: Duration | None = None
    """Wall seconds after which a message that was not delivered is given up; none = never."""
    mailbox: Annotated[int, msgspec.Meta(ge=1, le=10_000_000)] = 100_000
    """Messages that may wait for one receiver at one board, 1 to 10,000,000; further ones wait at their origin."""
    synchronous: Literal["full", "normal"] = "full"
    """SQLite's setting: `normal` may lose the last messages in a power failure, but not when a daemon dies."""


class Radio(FileModel, frozen=True, kw_only=True):
    """A model of the radio between robots, for mail in simulation."""

    range: Distance | None = None
    """Metres within which two robots hear each other; none = no limit."""
    loss: Annotated[float, msgspec.Meta(ge=0, lt=1)] = 0.0
    """Share of transmissions that are lost, from 0 to below 1."""
    delay: Duration = Duration(0)
    """Wall seconds of each transmission besides those that its size takes."""
    bandwidth: Annotated[float, msgspec.Meta(gt=0)] | None = None
    """Bits per second between two robots, more than 0; none = no limit."""
    seed: int = 0


class World(FileModel, frozen=True, kw_only=True):
    """The simulated world, which the fleet has to discover."""

    victims: Annotated[int, msgspec.Meta(ge=0, le=1000)] = 0
    """Number of victims in the water, 0 to 1000."""
    seed: int = 0
    """Random seed of their positions."""
    area: tuple[Latitude, Longitude, Latitude, Longitude]
    """Their area: its south, west, north and east border, in degrees."""


class Security(FileModel, frozen=True, kw_only=True):
    """Who may connect to the boards' routers besides the boards, each by a certificate of the fleet with its name."""

    operators: tuple[str, ...] = ()
    """Operators see everything, including mail; they may stop robots, change manifests and list mail."""
    observers: tuple[str, ...] | dict[str, Sight] = ()
    """Observers change nothing. They see `telemetry`, or what is given with their name, such as `{laptop: minds}`."""

    @property
    def sights(self) -> dict[str, Sight]:
        """The rights of each observer."""
        observers = self.observers
        return dict(observers) if isinstance(observers, dict) else dict.fromkeys(observers, "telemetry")


class MissionFile(FileModel, frozen=True, kw_only=True):
    """The top level of a mission file."""

    mission: str
    fleet: str | None = None
    boards: dict[str, Board] = {}
    agents: dict[str, Agent]
    robots: dict[str, Robot] = {}
    done: str | tuple[str, ...] = ()
    failed: str | tuple[str, ...] = ()
    timeout: Duration = Duration(900)
    grace: Duration = Duration(10)
    """Wall seconds that programs have to bring armed vehicles home by themselves before a failure ends the mission."""
    bring_home: Duration = Duration(300)
    """Mission seconds within which vehicles that are armed at the end of the mission are brought home."""
    speed: Annotated[float, msgspec.Meta(gt=0, le=100)] = 1.0
    restart: Literal["never", "on-failure"] = "never"
    wire: Literal["json", "msgpack"] = "json"
    router: Router = Router()
    clients: dict[str, Client] = {}
    gateway: Gateway | None = None
    mail: MailRules = MailRules()
    radio: Radio | None = None
    world: World | None = None
    security: Security | None = None
    inject: bool = False


@dataclass(frozen=True)
class Ending:
    """A formula over the beliefs of one agent that the mission's end depends on."""

    agent: str
    formula: str

    @property
    def functor(self) -> str:
        """The name of the beliefs that it is about, as far as its text shows it."""
        return self.formula.partition("(")[0]


@dataclass(frozen=True)
class Mission:
    """A mission file that has been read and checked."""

    name: str
    fleet: str
    boards: dict[str, Board]
    agents: dict[str, Agent]
    robots: dict[str, Robot]
    done: tuple[Ending, ...]
    """The mission is done when all of them hold."""
    failed: tuple[Ending, ...]
    """The mission has failed when one of them holds."""
    timeout: float
    """Mission seconds."""
    grace: float
    """Wall seconds."""
    bring_home: float
    """Mission seconds."""
    speed: float
    restart: Literal["never", "on-failure"]
    wire: Literal["json", "msgpack"]
    router: Router
    clients: dict[str, Client]
    gateway: Gateway | None
    mail: MailRules
    radio: Radio | None
    """None = mail between boards uses the real network only."""
    world: World | None
    security: Security
    secured: bool
    """Whether the mission has `security`: rights are enforced by keys, and mail between boards by `MailRights`."""
    inject: bool
    path: Path
    positions: Positions
    text: str = ""
    """The file as it was read."""

    def relative(self, path: str) -> Path:
        """Return a path of the mission file as seen from here: they are relative to the mission file."""
        return self.path.parent / path

    @property
    def names_router(self) -> bool:
        """Whether the file names its router: where that is, the mission runs, and nowhere else."""
        return ("router", "endpoint") in self.positions.values or self.router.external

    @property
    def board_names(self) -> list[str]:
        """The boards in the order of the file; a mission that declares none has this machine."""
        return list(self.boards) or [THIS_MACHINE]

    @property
    def mailboxes(self) -> dict[str, str]:
        """The receivers of mail (agents, clients, nodes) in the order of the file, each with the board that stores
        it."""
        boards = {name: agent.board for name, agent in self.agents.items()}
        boards |= {name: client.board for name, client in self.clients.items()}
        return boards | (dict.fromkeys(self.gateway.nodes, self.gateway.board) if self.gateway is not None else {})

    def host_of(self, board: str) -> str:
        """Return the host of a board's address; empty if it has none, or is not declared."""
        return self.boards[board].host if board in self.boards else ""

    def robots_on(self, board: str) -> list[str]:
        """Return the robots that a board serves."""
        return [name for name, robot in self.robots.items() if robot.board == board]

    @property
    def boards_with_agents(self) -> list[str]:
        """The boards that run agents, in the order of their agents."""
        return list(dict.fromkeys(agent.board for agent in self.agents.values()))

    def agents_on(self, board: str) -> list[str]:
        """Return the agents that run on a board."""
        return [name for name, agent in self.agents.items() if agent.board == board]

    def agents_of(self, robot: str) -> list[str]:
        """Return the agents that share a robot, and the clients that act as one."""
        members: dict[str, Agent | Client] = {**self.agents, **self.clients}
        return [name for name, member in members.items() if member.robot == robot]


def load_mission(path: str | Path) -> Mission:
    """Read a mission file, or the shipped mission of that name. Raises Findings with everything that is wrong."""
    path = mission_file(path)
    if not path.suffix and not path.exists():
        instead = did_you_mean(path.name, shipped_names("missions", ".yaml"))
        raise Findings.about(path, f"no such file, and no mission of that name ships{instead}")
    if other := other_kind(path, ".yaml"):
        raise Findings.about(path, f"expected a mission in YAML; {other}")
    return read_mission(read_text(path), path)


def read_mission(text: str, path: Path) -> Mission:
    """Read the text of the mission file at `path`. Raises Findings with everything that is wrong with it."""
    raw, positions = read_yaml(text, str(path))
    if not isinstance(raw, dict):
        raise Findings([positions.finding((), "expected a mission: fields such as `mission:` and `agents:`")])
    top, findings = convert(raw, MissionFile, positions, decode_hook)
    if top is None:
        raise Findings(findings)
    mission = Mission(
        name=top.mission,
        fleet=top.fleet or top.mission,
        boards=top.boards,
        agents=top.agents,
        robots=top.robots,
        done=_endings(top.done),
        failed=_endings(top.failed),
        timeout=float(top.timeout),
        grace=float(top.grace),
        bring_home=float(top.bring_home),
        speed=top.speed,
        restart=top.restart,
        wire=top.wire,
        router=top.router,
        clients=top.clients,
        gateway=top.gateway,
        mail=top.mail,
        radio=top.radio,
        world=top.world,
        security=top.security or Security(),
        secured=top.security is not None,
        inject=top.inject,
        path=path,
        positions=positions,
        text=text,
    )
    if findings := _check(mission):
        raise Findings(findings)
    return mission


def _endings(texts: str | tuple[str, ...]) -> tuple[Ending, ...]:
    split = (text.partition(":") for text in ((texts,) if isinstance(texts, str) else texts))
    return tuple(Ending(agent.strip(), formula.strip()) for agent, _, formula in split)


def _check(mission: Mission) -> list[Finding]:
    """Check the references between the parts of a mission."""
    where = mission.positions
    findings: list[Finding] = []
    if not mission.agents and not mission.clients:
        text = "agents: a mission needs at least one agent, or a program in `clients`"
        findings.append(where.finding(("agents",), text, at_key=True))

    def wrong(path: tuple[str | int, ...], message: str, at_key: bool = False) -> None:
        findings.append(where.finding(path, message, at_key=at_key))

    _check_names(mission, wrong)
    members: dict[str, Mapping[str, Agent | Client]] = {"agents": mission.agents, "clients": mission.clients}
    for kind, several in members.items():
        for name, member in several.items():
            if member.robot is not None and member.robot not in mission.robots:
                hint = did_you_mean(member.robot, mission.robots)
                wrong((kind, name, "robot"), f"there is no robot `{member.robot}`{hint}")
    for name, agent in mission.agents.items():
        if not (agent.on_restart in ("resume", "fresh") or agent.on_restart.startswith("goal(")):
            wrong(("agents", name, "on_restart"), f"expected resume, fresh or goal(...), got `{agent.on_restart}`")
        _check_accepts(mission, name, wrong)
    homes: dict[str, Mapping[str, Agent | Robot | Client]] = {
        "agents": mission.agents,
        "robots": mission.robots,
        "clients": mission.clients,
    }
    for kind, parts in homes.items():
        for name, part in parts.items():
            path: Steps = (kind, name, "board")
            if part.board in mission.board_names:
                continue
            if path not in where.values:
                wrong((kind, name), f"{kind}.{name}: needs `board:`, one of {', '.join(mission.boards)}")
            else:
                hint = did_you_mean(part.board, mission.board_names)
                wrong(path, f"{kind}.{name}: there is no board `{part.board}`{hint}")
    try:
        check_endpoint(mission.router.endpoint)
    except ValueError as error:
        wrong(("router", "endpoint"), f"router.endpoint: {str(error)[:1].lower()}{str(error)[1:]}")
    vehicles: dict[tuple[str, str, int], str] = {}
    _check_addresses(mission, wrong)
    if mission.gateway is not None:
        _check_gateway(mission, mission.gateway, wrong)
    for name, robot in mission.robots.items():
        other = vehicles.setdefault((robot.board, robot.link, robot.sysid), name) if robot.link else name
        if other != name:
            text = f"system {robot.sysid} on `{robot.link}` is robot `{other}` already: give each vehicle its own sysid"
            wrong(("robots", name, "link"), text)
        _check_lease(mission, name, wrong)
        if robot.agent_silence < LEAST_SILENCE:
            text = f"an agent reports once a second: expected {LEAST_SILENCE} s or more"
            wrong(("robots", name, "agent_silence"), f"agent_silence: {text}, got {robot.agent_silence}")
    for field, endings in (("done", mission.done), ("failed", mission.failed)):
        for index, ending in enumerate(endings):
            path = (field, index) if (field, index) in where.values else (field,)
            if not ending.formula:
                wrong(path, "expected `agent: formula`, such as `uav: mission_done`")
            elif ending.agent not in mission.agents:
                wrong(path, f"there is no agent `{ending.agent}`{did_you_mean(ending.agent, mission.agents)}")
    return findings


def _check_addresses(mission: Mission, wrong: Any) -> None:
    taken: dict[tuple[str, int], str] = {}
    for name, board in mission.boards.items():
        if not board.address:
            continue
        try:
            other = taken.setdefault(host_and_port(board.address, DEFAULT_PORT), name)
        except ValueError as error:
            wrong(("boards", name, "address"), f"boards.{name}.address: {error}")
            continue
        if other != name:
            wrong(("boards", name, "address"), f"boards.{name}.address: `{board.address}` is board `{other}` already")


def _check_gateway(mission: Mission, gateway: Gateway, wrong: Any) -> None:
    if gateway.board not in mission.board_names:
        if ("gateway", "board") in mission.positions.values:
            text = f"gateway: there is no board `{gateway.board}`{did_you_mean(gateway.board, mission.board_names)}"
            wrong(("gateway", "board"), text)
        else:
            wrong(("gateway",), f"gateway: needs `board:`, one of {', '.join(mission.boards)}")
    for path, address in ((("listen",), gateway.listen), *((("nodes", n), a) for n, a in gateway.nodes.items())):
        try:
            host_and_port(address)
        except ValueError as error:
            wrong(("gateway", *path), f"gateway.{'.'.join(path)}: {error}")


def _check_accepts(mission: Mission, agent: str, wrong: Any) -> None:
    made = tuple(f"{board}_" for board in mission.board_names)
    for sender, accepted in mission.agents[agent].accepts.items():
        where: Steps = ("agents", agent, "accepts", sender)
        if sender in RESERVED:
            text = f"accepts: `{sender}` sends notices alone, which every agent takes: leave it out"
            wrong(where, text, True)
        elif sender != ANYBODY and sender not in mission.mailboxes and not sender.startswith(made):
            hint = did_you_mean(sender, mission.mailboxes)
            wrong(where, f"accepts: there is no agent, client or node `{sender}`{hint}", True)
        for one in accepted if accepted != ALL else ():
            if hint := near_miss(one, PERFORMATIVES):
                wrong(where, f"accepts: no agent handles `{one}` by itself{hint}")


def _check_lease(mission: Mission, robot: str, wrong: Any) -> None:
    sharing, seen = mission.agents_of(robot), set[str]()
    for index, agent in enumerate(mission.robots[robot].lease.priority):
        where = ("robots", robot, "lease", "priority", index)
        if agent not in sharing:
            its = f"; its agents are {', '.join(sharing)}" if sharing else ""
            wrong(where, f"lease.priority: `{agent}` is no agent of robot `{robot}`{its}")
        elif agent in seen:
            wrong(where, f"lease.priority: `{agent}` is repeated")
        seen.add(agent)


def _check_names(mission: Mission, wrong: Any) -> None:
    for name, field in {mission.fleet: "fleet", mission.name: "mission"}.items():
        try:
            check_name(name)
        except ValueError as error:
            wrong((field,), f"{field}: {error}")
    seen: dict[str, str] = {}
    named: dict[str, Iterable[str]] = {
        "boards": mission.boards,
        "agents": mission.agents,
        "robots": mission.robots,
        "clients": mission.clients,
        "gateway.nodes": mission.gateway.nodes if mission.gateway is not None else (),
        "security.operators": mission.security.operators,
        "security.observers": mission.security.observers,
    }
    for kind, names in named.items():
        for name in names:
            if name in RESERVED:
                wrong((*kind.split("."), name), f"`{name}` is the sender of notices: give it another name", True)
            try:
                check_name(name)
            except ValueError as error:
                wrong((*kind.split("."), name), str(error), True)
            other = seen.setdefault(name, kind)
            if other != kind:
                wrong((*kind.split("."), name), f"`{name}` is in {other} already: names are unique in a fleet", True)
