"""The view at several sizes, on keys, with a fleet on paper."""

import asyncio
from collections.abc import Callable

import pytest
from rich.text import Text
from textual.events import Key
from textual.pilot import Pilot

from argosy.fleet_model.link import FleetLink
from argosy.watch import pages
from argosy.watch.app import WatchApp
from argosy.watch.mind_page import mind
from argosy.watch.overview_page import overview
from argosy.watch.row_text import ASCII, BAD, UNICODE, WARN, Row, glyphs_of
from argosy.watch.scroll_pane import ScrollPane
from schemas.wire import keys
from schemas.wire.mind_records import (
    ActivityEvent,
    BeliefView,
    DecisionView,
    EventView,
    FailureView,
    IntentionView,
    MindView,
    PlanView,
    QuestionView,
    RejectedView,
    WaitView,
)
from schemas.wire.records import Note, Queue
from tests.argosy.fleet_model.fleet import FLEET, Fleet, rescue
from tests.argosy.watch.shown import lines_of, link_to, press, shown, text_of, until
from tests.support import buses


def flying() -> Fleet:
    """A scout that flies to a place, with mail waiting, and a rescuer whose mind nobody has seen."""
    fleet = rescue().mind("scout", "+!visit(3)", "+!search", state="reasoning", cycle=120, time=33.0)
    fleet.action("scout", 1, "goto", "accepted", -27.6035123456789, -48.5182, 20)
    fleet.action("scout", 1, "goto", "running", -27.6035123456789, -48.5182, 20, feedback={"distance": 45.2})
    fleet.mail("pi1", Queue(box="inbox", sender="rescuer1", receiver="scout", messages=3, oldest=4.0))
    fleet.activity("scout", ActivityEvent(kind="print", text="hello there"))
    return fleet.comes("rescuer1", "agentd").waits(1)


def thinking() -> Fleet:
    """A scout whose mind has something of everything."""
    fleet = flying()
    plan = PlanView(trigger="+!visit(N)", position="missions/scout.asl:30", bindings={"N": "3"})
    other = PlanView(label="p1", trigger="+!visit(N)", position="missions/scout.asl:20", bindings={"N": "3"})
    rejected = RejectedView(plan=other, why="context", literal="free(N)", filled="free(3)", message="free(3) fails")
    view = MindView(
        agent="scout",
        cycle=121,
        time=40.0,
        state="reasoning",
        intentions=(
            IntentionView(
                id=4,
                state="waiting",
                waits_for=WaitView(kind="action", name="goto"),
                stack=("+!visit(3)", "+!search"),
                at="scout.asl:31",
                since=30.0,
            ),
        ),
        beliefs=(
            BeliefView(text="victim(3)[source(rescuer1)]", sources=("rescuer1",), since=38.0),
            BeliefView(text="height(20)[source(self)]", sources=("self",), since=0.0),
        ),
        events=(EventView(text="+seen(9)"),),
        mailbox=2,
        questions=(
            QuestionView(id="q", receiver="rescuer1", performative="askOne", content="at(X)", asked=35.0, until=45.0),
        ),
        decisions=(
            DecisionView(
                cycle=100,
                time=30.0,
                event="+!visit(3)",
                kind="+!",
                name="visit/1",
                chosen=plan,
                rejected=(rejected,),
                outcome="running",
            ),
        ),
        failures=(
            FailureView(
                cycle=90,
                time=25.0,
                formula="takeoff(20)",
                position="scout.asl:9",
                error="action_failed",
                reason="not armed",
            ),
        ),
        dropped={"events": 7},
        done={"mission_done": False},
    )
    fleet.model.mind("scout", view, detailed=True)
    return fleet


def silent() -> Fleet:
    """A scout whose daemon is well and whose mind does not answer."""
    fleet = flying().waits(6)
    fleet.told("scout", "agentd").model.mind_unanswered("scout", "busy")
    return fleet


def noted() -> Fleet:
    """Two robots with the same note."""
    fleet = flying().comes("uav2", "bridged")
    none = (Note("failsafe_none", "failsafe: none"),)
    return fleet.told("uav1", "bridged", notes=none, percepts={"scout": "x"}).told("uav2", "bridged", notes=none)


def without_a_router() -> FleetLink:
    """A link that reaches no router."""
    link = link_to(Fleet())
    link.reached, link.problem = False, "no router at tcp/127.0.0.1:7447: Nobody listens there"
    return link


def told_late() -> Fleet:
    """A scout that tells what it did first after what it did second."""
    fleet = flying().waits(10)
    fleet.activity("scout", ActivityEvent(kind="print", text="second", time=99.0))
    return fleet.activity("scout", ActivityEvent(kind="print", text="first", time=96.0), now=100.0, speed=1.0)


def fifty() -> Fleet:
    """More agents than a screen has lines."""
    fleet = Fleet()
    for number in range(50):
        fleet.comes(f"agent{number:02}", "agentd").mind(f"agent{number:02}", "+!search")
    return fleet


MIND = ("down", "down", "enter")
"""The keys that lead to the mind of the scout."""
Looks = tuple[Callable[[], Fleet | FleetLink], tuple[int, int], tuple[str, ...], tuple[str, ...]]
SHOWN: dict[str, Looks] = {
    "vehicles, agents, boards and what happens": (
        flying,
        (80, 24),
        (),
        (
            "argosy watch sar  2 of 2 agents  1 of 1 robot  1 of 1 board",
            "●  uav1  GUIDED  armed  20.0 m  0 m off  ▸ goto(-27.603512,-48.5182,20)  1.0 s",
            "●  scout     flying  1  +!visit(3)  goto(-27.603512,-48.5182,20)  uav.…  mail 3",
            "●  rescuer1             its mind has not answered yet",
            "●  pi1  3 messages waiting",
            "scout  hello there",
        ),
    ),
    "how old what is old is": (
        lambda: flying().waits(8),
        (160, 24),
        (),
        ("no reports;  +!visit(3)", "as it was 9.0 s ago: its bridged is silent"),
    ),
    "who is gone": (
        lambda: flying().goes("scout", "agentd").waits(4),
        (80, 24),
        (),
        ("1 of 2 agents", "○  scout", "its agentd is not there (gone for 4.0 s)"),
    ),
    "a mind that does not answer": (silent, (80, 24), (), ("SILENT for 7.0 s; was:",)),
    "a note of several robots once": (noted, (80, 24), (), ("!  uav1, uav2: failsafe: none",)),
    "why there is no router": (
        without_a_router,
        (80, 24),
        (),
        ("no router yet, waiting for 0.0 s: no router at tcp/127.0.0.1:7447",),
    ),
    "what was told late where it happened": (told_late, (80, 24), (), ("first", "second")),
    "the last of fifty agents": (fifty, (80, 24), ("end",), ("▌●  agent49",)),
    "the mind of the last of fifty": (fifty, (80, 24), ("end", "enter"), ("agent49  waiting",)),
    "the agent of a robot": (flying, (80, 24), ("home", "enter"), ("scout  flying  robot uav1",)),
    "stack, action, event, question, mail and what was dropped": (
        thinking,
        (80, 40),
        MIND,
        (
            "INTENTIONS 1",
            "4  waiting for the action goto  10 s  scout.asl:31",
            "     ‹ +!search",
            "▸ goto(-27.603512,-48.5182,20)  running 1.0 s  distance 45.2",
            "EVENTS THAT WAIT 1",
            "to rescuer1    askOne at(X)  for 5.0 s, gives up in 5.0 s",
            "MAIL 2 TAKEN IN AND NOT READ",
            "rescuer1 > scout  3 messages in the inbox of pi1  oldest 4.0 s",
            "7 events",
            "○  mission_done  done when",
        ),
    ),
    "beliefs below who told them, with their age": (
        thinking,
        (80, 24),
        (*MIND, "2"),
        ("FROM RESCUER1 1", "   victim(3)  2.0 s", "   height(20)  40 s"),
    ),
    "all panes of an agent on a large screen": (
        thinking,
        (140, 40),
        MIND,
        ("1 MIND", "2 BELIEFS", "INTENTIONS 1", "FROM RESCUER1 1", "3 DECISIONS", "4 TIMELINE"),
    ),
    "how old a mind is": (lambda: thinking().waits(4), (160, 40), MIND, ("as it was 4.0 s ago",)),
}
"""A fleet, the size of the terminal, the keys that are pressed, and the words that the screen has then."""


@pytest.mark.parametrize("what", SHOWN)
def test_the_view_shows(what: str) -> None:
    make, size, pressed, words = SHOWN[what]

    @shown(make, size)
    async def looks(app: WatchApp, pilot: Pilot[None]) -> None:
        await press(app, pilot, *pressed)
        for one in words:
            await until(app, pilot, one)
        assert [one for one in words if one not in text_of(app)] == []
        if what.startswith("what was told late"):
            assert text_of(app).index("first") < text_of(app).index("second")

    looks()


@pytest.mark.parametrize("size", [(20, 6), (40, 12), (80, 24), (200, 60)])
@shown(thinking)
async def test_no_line_is_longer_than_the_screen_and_the_keys_stay_at_its_end(
    app: WatchApp, pilot: Pilot[None], size: tuple[int, int]
) -> None:
    for page in ("enter look", "1 mind"):
        await until(app, pilot, page)
        lines = lines_of(app)
        assert len(lines) == size[1]
        assert max(map(len, lines)) <= size[0]
        assert page in lines[-1]
        await press(app, pilot, "enter")


@shown(flying)
async def test_enter_looks_into_the_agent_of_the_row_and_escape_comes_back(app: WatchApp, pilot: Pilot[None]) -> None:
    assert not app.link._looked_at["scout"]
    await press(app, pilot, "down", "down", "enter")
    await until(app, pilot, "INTENTIONS 1")
    assert app.link._looked_at["scout"] == 1
    await press(app, pilot, "escape")
    await until(app, pilot, "TIMELINE")
    await buses.until(lambda: not app.link._looked_at["scout"], "the details of its mind are not asked for")


@shown(thinking, (100, 24))
async def test_a_decision_tells_why_when_it_is_opened(app: WatchApp, pilot: Pilot[None]) -> None:
    await press(app, pilot, "down", "down", "enter", "3")
    await until(app, pilot, "takeoff(20) fails  action_failed: not armed  scout.asl:9")
    await press(app, pilot, "enter")
    await until(app, pilot, "chosen: +!visit(N) (scout.asl:30), with N = 3")
    await until(app, pilot, "not @p1 +!visit(N) (scout.asl:20): free(N) does not hold, with N = 3")
    await press(app, pilot, "enter")
    await until(app, pilot, "chosen:", shown=False)


@shown(thinking, (130, 34))
async def test_no_line_of_an_agents_panes_is_made_before_they_have_their_width(
    app: WatchApp, pilot: Pilot[None], monkeypatch: pytest.MonkeyPatch
) -> None:
    widths: list[int] = []
    folded = ScrollPane._folded

    def noted(self: ScrollPane, row: Row, width: int) -> list[Text]:
        widths.append(width)
        return folded(self, row, width)

    monkeypatch.setattr(ScrollPane, "_folded", noted)
    widths.clear()
    await press(app, pilot, "enter")
    await until(app, pilot, "height(20)")
    assert min(widths) > 40


@shown(flying)
async def test_left_and_right_go_to_the_next_agent(app: WatchApp, pilot: Pilot[None]) -> None:
    await press(app, pilot, "down", "down", "enter", "left")
    await until(app, pilot, "rescuer1  its mind has not answered yet")
    assert app.link._looked_at["rescuer1"] == 1
    assert not app.link._looked_at["scout"]


@shown(flying, (80, 30))
async def test_a_filter_shows_what_has_its_words_and_says_what_it_leaves_out(app: WatchApp, pilot: Pilot[None]) -> None:
    await press(app, pilot, "tab", "slash", *"hello", "enter")
    await until(app, pilot, "left out")
    await until(app, pilot, "vehicle connected", shown=False)
    assert "filter: hello" in text_of(app)
    assert "scout  hello there" in text_of(app)
    await press(app, pilot, "escape")
    await until(app, pilot, "vehicle connected")


@shown(flying, filter="there -hello")
async def test_a_filter_may_be_given_at_the_start_and_may_hide_words(app: WatchApp, pilot: Pilot[None]) -> None:
    await until(app, pilot, "agentd is there")
    assert "vehicle connected" not in text_of(app)


@shown(flying)
async def test_letters_that_are_keys_may_be_written_into_a_filter(app: WatchApp, pilot: Pilot[None]) -> None:
    await press(app, pilot, "slash", *"qh 2", "escape")
    assert "TIMELINE" in text_of(app)
    assert app.is_running


@shown(flying)
async def test_a_pause_holds_the_view_while_the_fleet_goes_on(app: WatchApp, pilot: Pilot[None], fleet: Fleet) -> None:
    await press(app, pilot, "space")
    await until(app, pilot, "PAUSED")
    fleet.percept("scout", "state", "RTL", True, True).activity("scout", ActivityEvent(kind="print", text="going home"))
    await pilot.pause(0.2)
    assert "GUIDED" in text_of(app)
    assert "going home" not in text_of(app)
    await press(app, pilot, "space")
    await until(app, pilot, "PAUSED", shown=False)
    await until(app, pilot, "going home")
    await until(app, pilot, "RTL")


@shown(flying)
async def test_a_lost_router_is_said_at_once_with_how_long_and_is_over_when_it_is_back(
    app: WatchApp, pilot: Pilot[None], fleet: Fleet
) -> None:
    fleet.model.router(up=False)
    fleet.waits(12)
    await until(app, pilot, "ROUTER LOST for 12 s: the last known state is shown; reconnecting")
    fleet.model.router(up=True)
    await until(app, pilot, "answers again, after 12.0 s")
    assert "ROUTER LOST" not in text_of(app)


@shown(Fleet)
async def test_that_nobody_is_there_is_said_then_what_to_do(app: WatchApp, pilot: Pilot[None], fleet: Fleet) -> None:
    await until(app, pilot, "no daemon of fleet sar is on the bus yet, waiting for 0.0 s")
    fleet.model.token(keys.alive("other", "x", "agentd", "b"), alive=True)
    fleet.waits(15)
    await until(app, pilot, "waiting for 15 s")
    await until(app, pilot, "at this router there is other: --fleet NAME")
    fleet.comes("scout", "agentd")
    await until(app, pilot, "1 of 1 agent")
    assert "nobody" not in text_of(app)


def test_an_alarm_stands_before_other_notes_and_looks_like_an_error() -> None:
    alarm = Note(code="robot_unattended", text="in the air with nobody in charge")
    fleet = flying()
    notes = (Note("failsafe_none", "failsafe: none"), alarm)
    fleet.told("uav1", "bridged", notes=notes, percepts={"scout": "x"})
    rows = [row.text for row in overview(fleet.model, 100, UNICODE) if row.text.plain.startswith("!")]
    assert [row.plain for row in rows] == [f"!  uav1: {alarm.text}", "!  uav1: failsafe: none"]
    assert [[str(one.style) for one in row.spans] for row in rows] == [[BAD], [WARN]]


def test_members_that_the_model_has_forgotten_are_counted_in_the_overview() -> None:
    fleet = flying()
    for number in range(2, 600):
        fleet.model.token(keys.alive(FLEET, f"a{number}", "agentd", "b"), alive=True)
    fleet.model.tick()
    assert fleet.model.roster.forgotten > 0
    last = overview(fleet.model, 100, UNICODE)[-1].text.plain
    assert last.startswith(f"{fleet.model.roster.forgotten} members forgotten: ")


@shown(flying)
async def test_the_help_tells_the_keys(app: WatchApp, pilot: Pilot[None]) -> None:
    await press(app, pilot, "question_mark")
    await until(app, pilot, "gives orders")
    await press(app, pilot, "escape")
    await until(app, pilot, "TIMELINE")


@pytest.mark.parametrize("key", ["q", "ctrl+c"])
@shown(flying)
async def test_the_view_is_left_by(app: WatchApp, pilot: Pilot[None], key: str) -> None:
    await pilot.press(key)
    await buses.until(lambda: not app.is_running, "it ends")


@shown(thinking, glyphs=ASCII)
async def test_a_console_without_unicode_gets_plain_marks_everywhere(app: WatchApp, pilot: Pilot[None]) -> None:
    for _ in range(3):
        assert text_of(app).isascii()
        await press(app, pilot, "down", "down", "enter")


@pytest.mark.parametrize(
    ("term", "encoding", "expected"),
    [
        ("xterm-256color", "utf-8", UNICODE),
        ("screen", "UTF-8", UNICODE),
        ("linux", "utf-8", ASCII),
        ("xterm", "ascii", ASCII),
    ],
)
def test_the_marks_are_those_that_the_terminal_has(term: str, encoding: str, expected: object) -> None:
    assert glyphs_of({"TERM": term}, encoding) is expected


@shown(flying)
async def test_the_timeline_follows_unless_scrolled_back(app: WatchApp, pilot: Pilot[None], fleet: Fleet) -> None:
    await press(app, pilot, "down", "down", "enter", "4")
    for number in range(100):
        fleet.activity("scout", ActivityEvent(kind="print", text=f"line {number}"))
    await until(app, pilot, "line 99")
    await press(app, pilot, "pageup", "pageup")
    fleet.activity("scout", ActivityEvent(kind="print", text="line 100"))
    await pilot.pause(0.3)
    assert "line 100" not in text_of(app)
    await press(app, pilot, "end")
    await until(app, pilot, "line 100")


def test_the_age_of_an_action_is_in_mission_seconds_on_every_page() -> None:
    model = flying().waits(3).model
    model.clock.speed = 10.0
    for rows in (overview(model, 120, UNICODE), mind(model, model.agents["scout"], UNICODE)):
        [line] = [row.text.plain for row in rows if "▸ goto" in row.text.plain]
        assert "  40 s" in line or "running 40 s" in line


@shown(lambda: flying().waits(8), (200, 40))
async def test_an_action_of_which_nobody_tells_says_so_and_how_it_ended_is_not_known_once_its_agent_is_gone(
    app: WatchApp, pilot: Pilot[None], fleet: Fleet
) -> None:
    await until(app, pilot, "▸ goto(-27.603512,-48.5182,20)  9.0 s  not heard for 9.0 s")
    fleet.goes("scout", "agentd").waits(1)
    await press(app, pilot, "down", "down", "enter")
    await until(app, pilot, "not known how it ended: its agent is gone")
    await until(app, pilot, "ACTIONS 0 RUNNING")
    await until(app, pilot, "GONE, as it was 10 s ago")


@shown(flying)
async def test_what_nobody_has_caught_ends_it_with_one_line(app: WatchApp) -> None:
    app._exception = ValueError("a defect\x1b[2J")
    app._fatal_error()
    (line,) = app._exit_renderables
    assert str(line) == ("error: defect in argosy watch: ValueError: a defect [2J; ARGOSY_DEBUG=1 shows where")
    app._exception = None


def test_a_row_has_nothing_that_a_terminal_takes_for_a_command_and_keeps_its_styles() -> None:
    row = Row(Text.assemble("a\x1b]0;T\x07", ("b\x9b2J\u202e\n", "bold")))
    assert row.text.plain.isprintable()
    assert row.text.plain.startswith("a ]0;T")
    assert [row.text.plain[one.start : one.end].strip() for one in row.text.spans] == ["b 2J"]


@shown(flying)
async def test_a_change_of_size_that_textual_loses_is_followed(app: WatchApp, pilot: Pilot[None]) -> None:
    app._resize_timer = app.set_timer(1000, lambda: None)  # one that was late, and never fires
    await pilot.resize_terminal(50, 12)
    await buses.until(lambda: len(lines_of(app)) == 12, "it is drawn for the new size")


@shown(flying)
async def test_the_view_ends_without_error_in_whatever_time(app: WatchApp, monkeypatch: pytest.MonkeyPatch) -> None:
    closing = app._close_messages

    async def close(wait: bool = True) -> None:
        await asyncio.sleep(5 * app.period)
        await closing(wait)

    monkeypatch.setattr(app, "_close_messages", close)


@shown(flying)
async def test_letters_that_follow_the_slash_immediately_are_the_filters(app: WatchApp, pilot: Pilot[None]) -> None:
    driver = app._driver
    assert driver is not None
    for key in ("tab", "slash", *"qhello"):
        driver.send_message(Key(key, "/" if key == "slash" else key if len(key) == 1 else None))
    await until(app, pilot, "filter: qhello")
    assert app.is_running


@shown(lambda: thinking().waits(600).mind("scout", "+!new_goal", time=640.0).told("scout", "agentd"), (160, 40))
async def test_details_of_long_ago_are_not_the_mind_of_now(app: WatchApp, pilot: Pilot[None]) -> None:
    await press(app, pilot, "down", "down", "space", "enter")
    await until(app, pilot, "640 s of mission")
    await until(app, pilot, "+!new_goal")
    await until(app, pilot, "height(20)")
    assert "+!visit(3)" not in text_of(app).partition("BELIEFS")[0]
    assert text_of(app).count("as it was 600 s ago") + text_of(app).count("as it was 10 min ago") == 2


@shown(flying, (160, 24))
async def test_what_cannot_be_drawn_is_one_line_and_the_view_goes_on(
    app: WatchApp, pilot: Pilot[None], fleet: Fleet, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> list[object]:
        raise ValueError("cannot convert\x1b[2J float infinity to integer")

    await until(app, pilot, "GUIDED")
    drawn = pages.overview
    monkeypatch.setattr(pages, "overview", broken)
    await until(app, pilot, "defect in argosy watch: this cannot be drawn, and stays as it was: ValueError: cannot")
    assert "GUIDED" in text_of(app)
    assert app.is_running
    monkeypatch.setattr(pages, "overview", drawn)
    await until(app, pilot, "defect", shown=False)
    fleet.model.defect = "who is there is not known"
    await until(app, pilot, "defect in argosy watch: who is there is not known")
