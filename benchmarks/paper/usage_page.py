"""What `benchmarks.paper.usage` found, as tables and plots beside the paper's own figures."""

from __future__ import annotations

from typing import Final

from benchmarks import peers
from benchmarks.flights import RESCUE, SINGLE
from benchmarks.paper.usage_figures import ALL, BDI, BOARD, IMPERATIVE, Figures, Measured, Usage
from benchmarks.paper.usage_goals import ONE_PAIR, TITLES, alone
from benchmarks.results import Origin
from benchmarks.sampling import AGENT, ROLES

APPROACHES: Final = {BDI: "AgentSpeak", IMPERATIVE: "Python"}
THEIRS: Final = {BDI: "Jason", IMPERATIVE: "Python"}
BOARDS: Final = {"pi1": "Scout", "pi2": "Rescuer 1", "pi3": "Rescuer 2", ALL: ALL}
"""The paper's names of the boards of search and rescue."""
PI_CORES: Final = 4
"""The paper's per cents of processor are of all cores of its board."""


def in_short(figures: Figures) -> list[str]:
    """Return rows for a table of what Argosy is beside others: what the BDI approach costs a board, at speed 1."""
    theirs = {title.removeprefix("the paper, "): ratios for title, ratios, _ in paper_ratios()}
    rows = []
    for mission, speed in figures.flown():
        if speed != 1:
            continue
        mine, its = (figures.of(mission, speed, approach).row(BOARD) for approach in APPROACHES)
        cpu, memory = theirs[TITLES[mission]]
        one = ONE_PAIR if len(figures.pairs(mission, speed)) == 1 else ""
        rows.append(
            f"| agents instead of imperative programs, {TITLES[mission]}: a board's processor and memory "
            f"| {mine.cpu.mean / its.cpu.mean:.2f}x, {mine.rss.mean / its.rss.mean:.2f}x{one} "
            f"| Jason in the paper {cpu:.2f}x, {memory:.2f}x "
            f"([measured](docs/measurements/benchmarks.md#processor-and-memory)) |"
        )
    return rows


def in_comparison(figures: Figures) -> list[str]:
    """Return the row of boards' memory in docs/measurements/comparison.md: what, memory, of which machine, source."""
    flown = [
        one for one in figures.usages if (one.mission, one.speed, one.approach) == (SINGLE.mission, 1.0, IMPERATIVE)
    ]
    return [
        f"| Argosy with an imperative program in agentd's place, in flight | {one.row(BOARD).pss.mean:.0f} MB (PSS)"
        + (
            f"; {sum(one.alone.values()):.0f} MB if nothing else on the machine shares their libraries"
            if one.alone
            else ""
        )
        + " | a computer | [benchmarks.md](benchmarks.md#processor-and-memory) |"
        for one in flown
    ]


def blocks(origin: Origin, figures: Figures) -> dict[str, str]:
    """Return the tables and where the plots stand."""
    lines = [origin.line(), ""]
    for mission, title in TITLES.items():
        if any(one.mission == mission for one in figures.usages):
            lines += [f"### {'Table 3' if mission == SINGLE.mission else 'Table 5'}: {title}", ""]
            lines += [*_paper_table(figures, mission), "", *_daemons(figures, mission), "", *_flights(figures, mission)]
            lines += ["", f"![{title}: processor and memory over one flight](figures/{picture_of(mission)}.svg)", ""]
    lines += ["### The two approaches", "", *_ratios(figures), ""]
    lines += ["![AgentSpeak beside Python: ours and the paper's](figures/usage-ratios.svg)"]
    return {"paper-usage": "\n".join(lines)}


_PAPER_HEAD: Final = (
    "| board | approach | speed | CPU, % of a core: mean | std | max | memory, % of a Pi 3: mean | std | max | "
    "RSS, MB | PSS, MB | alone, MB |",
    "|---|---|---|---|---|---|---|---|---|---|---|---|",
)


def _paper_table(figures: Figures, mission: str) -> list[str]:
    """The paper's rows, and ours: a board's processes together."""
    lines = list(_PAPER_HEAD)
    for board in _boards(figures, mission):
        for approach, theirs in THEIRS.items():
            row = peers.TABLE_3[theirs] if mission == SINGLE.mission else peers.TABLE_5[theirs][BOARDS[board]]
            cpu = peers.Usage(*(PI_CORES * one for one in (row.cpu.mean, row.cpu.std, row.cpu.max)))
            lines.append(
                f"| {_name(mission, board)} | the paper's {theirs} | not told | {_told(cpu)} "
                f"| {_told(row.memory)} | | | |"
            )
            for one in _usages(figures, mission, approach):
                lines.append(_our_row(one, board))
    return lines


def _our_row(one: Usage, board: str) -> str:
    row = one.row(BOARD, board)
    percent = Measured(*(100 * value / peers.PI_MB for value in (row.rss.mean, row.rss.std, row.rss.max)))
    told = [value for where, value in one.alone.items() if board in (ALL, where)]
    held = f"{sum(told) / len(told):.1f}" if told else "not told here"
    return (
        f"| {_name(one.mission, board)} | **{APPROACHES[one.approach]}** | {one.speed:g} | {_told(row.cpu)} "
        f"| {_told(percent)} | {row.rss.mean:.1f} | {row.pss.mean:.1f} | {held} |"
    )


def _daemons(figures: Figures, mission: str) -> list[str]:
    lines = [
        "| process | approach | speed | CPU, % of a core: mean | std | max | RSS, MB: mean | std | max | PSS, MB |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for who in dict.fromkeys(ROLES.values()):
        for approach, title in APPROACHES.items():
            for one in _usages(figures, mission, approach):
                row = one.row(who)
                lines.append(
                    f"| {who} | {title} | {one.speed:g} | {_told(row.cpu)} | {_told(row.rss)} | {row.pss.mean:.1f} |"
                )
    return lines


def _flights(figures: Figures, mission: str) -> list[str]:
    """The pairs of flights, and what was lost."""
    lines = [
        "| speed, pair | AgentSpeak: s | samples | board, CPU % | RSS, MB | Python: s | samples | board, CPU % "
        "| RSS, MB | board: CPU | RSS | agent's process: CPU | RSS |",
        "|---|" + "---|" * 12,
    ]
    lost = []
    for speed in (speed for flown, speed in figures.flown() if flown == mission):
        for number, pair in enumerate(figures.pairs(mission, speed), 1):
            each = " | ".join(
                f"{one.seconds:.0f} | {one.samples} | {one.cpu[BOARD]:.2f} | {one.rss[BOARD]:.1f}" for one in pair
            )
            mine, its = pair
            ratios = " | ".join(
                f"{used[who] / by[who]:.2f}x"
                for who in (BOARD, AGENT)
                for used, by in ((mine.cpu, its.cpu), (mine.rss, its.rss))
            )
            lines.append(f"| {speed:g}, {number} | {each} | {ratios} |")
        for approach, title in APPROACHES.items():
            one = figures.of(mission, speed, approach)
            whys = f" ({'; '.join(one.again)})" if one.again else ""
            lost.append(f"{title} at speed {speed:g} {len(one.again)} of {len(one.again) + len(one.flights)}{whys}")
    told = "Flights one by one, means of the boards; every second pair was flown in the opposite order."
    return [told, "", *lines, "", f"Flights that were not done and were flown again: {', '.join(lost)}."]


def _ratios(figures: Figures) -> list[str]:
    lines = [
        "| AgentSpeak beside Python | board: CPU | RSS | PSS | alone | agent's process: CPU | RSS | PSS |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for title, board, agent in paper_ratios():
        lines.append(f"| {title} | {board[0]:.2f}x | {board[1]:.2f}x | | | {agent} |")
    for mission, speed in figures.flown():
        bdi, other = figures.of(mission, speed, BDI), figures.of(mission, speed, IMPERATIVE)
        told = []
        for who in (BOARD, AGENT):
            mine, its = bdi.row(who), other.row(who)
            told += [f"{getattr(mine, what).mean / getattr(its, what).mean:.2f}x" for what in ("cpu", "rss", "pss")]
            if who == BOARD:
                held = alone(bdi, other)
                told.append("not told" if held is None else f"{held:.2f}x")
        lines.append(f"| {TITLES[mission]}, speed {speed:g} | {' | '.join(told)} |")
    return lines


def paper_ratios() -> list[tuple[str, tuple[float, float], str]]:
    """By mission: a board's CPU and memory in Jason beside Python; the agent's process from its own measurements."""
    found = []
    jason, python = peers.PROCESSES["Jason agent"], peers.PROCESSES["Python agent"]
    agent = (
        f"{_middle(jason.cpu) / _middle(python.cpu):.1f}x | {_middle(jason.memory) / _middle(python.memory):.1f}x | "
    )
    for title, table in ((SINGLE.title, peers.TABLE_3), (RESCUE.title, {k: v[ALL] for k, v in peers.TABLE_5.items()})):
        mine, its = table["Jason"], table["Python"]
        ratios = mine.cpu.mean / its.cpu.mean, mine.memory.mean / its.memory.mean
        found.append((f"the paper, {title}", ratios, agent))
    return found


def picture_of(mission: str) -> str:
    """Return the name of the plot of a mission's flight."""
    return "usage-single" if mission == SINGLE.mission else "usage-rescue"


def _usages(figures: Figures, mission: str, approach: str) -> list[Usage]:
    return [one for one in figures.usages if (one.mission, one.approach) == (mission, approach)]


def _boards(figures: Figures, mission: str) -> list[str]:
    if mission == SINGLE.mission:
        return [ALL]
    boards = [row.board for one in figures.usages if one.mission == mission for row in one.rows]
    return [*(board for board in dict.fromkeys(boards) if board != ALL), ALL]


def _name(mission: str, board: str) -> str:
    return "the only one" if mission == SINGLE.mission else BOARDS[board]


def _told(spread: Measured | peers.Usage) -> str:
    return f"{spread.mean:.2f} | {spread.std:.2f} | {spread.max:.2f}"


def _middle(ends: tuple[float, float]) -> float:
    return sum(ends) / 2
