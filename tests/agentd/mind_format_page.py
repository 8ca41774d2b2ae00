"""The example of a mind on docs/reference/records.md: `python -m tests.agentd.mind_format_page` writes it."""

import asyncio
import json
import re
import sys
import tempfile
from pathlib import Path
from typing import Any, Final

from agentd.language.parse import parse_formula
from agentd.mind.data.inputs import Mail, PerceptReplaced
from commd.bus.bus import Bus
from schemas.wire import keys
from schemas.wire.mind_records import MindOrder
from schemas.wire.records import Outcome
from tests.agentd.hosts import host_on
from tests.agentd.minds import term
from tests.docs.pages import ROOT, with_part
from tests.support.buses import Connect, on_a_bus, served, until
from tests.support.ports import free_port

PAGE: Final = ROOT / "docs/reference/records.md"
_STEADY: Final = {
    "stamp": 1795334400000000000,
    "boot": "5f0c2a9d",
    "seq": 1,
    "time": 42.5,
    "since": 40.0,
    "asked": 40.0,
    "until": 100.0,
    "paused_for": 598.2,
    "cycle": 9,
}
"""What differs from run to run, as the page has it."""


def program() -> str:
    found = re.search(r"```asl title=\"scout.asl\"\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    return found[1]


def script() -> str:
    found = re.search(r"```python title=\"mind.py\"\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    return found[1]


def steady(value: Any) -> Any:
    """JSON with what differs from run to run made the same."""
    if isinstance(value, dict):
        return {name: _STEADY[name] if name in _STEADY else steady(inner) for name, inner in value.items()}
    if isinstance(value, list):
        return [steady(inner) for inner in value]
    if isinstance(value, str):
        return re.sub(r"\b(sync\d+\.\w+)\.\w{8}\b", r"\1.5f0c2a9d", value)
    return value


def example(endpoint: str, folder: Path, meanwhile: Any = None) -> Any:
    """The mind of the page's program, as it is on the wire."""
    found: list[Any] = []

    async def body(connect: Connect) -> None:
        agents, operator = await connect("pi1"), await connect("operator", "argosy")
        done = {"victim(_,_)": parse_formula("victim(_,_)")}
        scout = await host_on(agents, "scout", program(), folder, others=("ana",), inject=True, done=done)
        control, mind = keys.control("test", "scout"), keys.mind("test", "scout")
        await served(operator, control)
        await until(lambda: len(scout.host.viewer.view().questions) == 1, "it asks ana")
        scout.tell(Mail("ana", "tell", term("victim(30,40)"), "mid1.ana"))
        scout.host.feed(PerceptReplaced(term("altitude(0)")))
        await until(lambda: "ana has found somebody" in scout.prints, "it hears of the victim")
        for order in (
            MindOrder(do="pause"),
            MindOrder(do="goal", text="report(1)"),
            MindOrder(do="goal", text="report(2)"),
            MindOrder(do="step"),
        ):
            async for reply in operator.query(control, order, Outcome, 10.0):
                assert reply.record is not None, reply.error
                assert reply.record.ok, reply.record.reason
        found.append(await _raw(operator, f"{mind}?plans=true"))
        if meanwhile is not None:
            await asyncio.to_thread(meanwhile)
        await scout.end()

    on_a_bus(endpoint, body)
    return found[0]


async def _raw(bus: Bus, selector: str) -> Any:
    """What is on the wire: the bytes, and that they are the record they say."""

    def ask() -> Any:
        (reply,) = list(bus._session.get(selector))
        assert str(reply.ok.encoding) == "application/json;argosy.MindView/1"
        return json.loads(reply.ok.payload.to_bytes())

    return await asyncio.to_thread(ask)


def shown(mind: Any) -> str:
    return f"```json\n{json.dumps(steady(mind), indent=1, ensure_ascii=False)}\n```\n"


def main() -> None:
    """Write the page's example."""
    with tempfile.TemporaryDirectory() as folder:
        made = shown(example(f"tcp/127.0.0.1:{free_port()}", Path(folder)))
    PAGE.write_text(with_part(PAGE, "example", made), encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
