"""Services across boards: offered on one, found on all, also while their board is away and after restarts."""

from collections.abc import Callable

from tests.boards.fleet import Fleet

_MISSION = """\
mission: services
boards: BOARDS
agents:
  ann: {program: seeker.asl, board: pi1}
  bob: {program: offerer.asl, board: pi2}
  cid: {program: offerer.asl, board: pi3}
"""
_OFFERER = """\
!begin.
+!begin <- .df_register("rescue").
+!stop <- .df_deregister("rescue"); +stopped.
"""
_SEEKER = """\
!begin.
+!begin <- .df_subscribe("rescue"); !seek.
+!seek <- .df_search("rescue", L); .sort(L, S); -+found(S); .wait(200); !!seek.
+provider(A, S) <- .print("told of ", A, " ", S).
+restarted(_) <- !!seek.
"""


def test_what_is_offered_on_one_board_is_found_on_another_also_while_that_is_away(fleet: Callable[..., Fleet]) -> None:
    team = fleet(_MISSION, seeker=_SEEKER, offerer=_OFFERER)
    team.up()
    look = team.look("pi1")
    look.believes("ann", "found([bob,cid])")
    seeker = team.running["pi1", "agentd"]
    seeker.until(lambda text: "told of bob" in text and "told of cid" in text, "ann is told of both")
    assert seeker.text.count("told of bob") == 1
    team.kill("pi3")
    team.kill("pi1", "commd")
    team.start("pi1", "commd")
    team.ready("pi1", "commd")
    look.until(lambda look: "cid/agentd" not in look.alive() and look.alive(), "cid is gone")
    look.believes("ann", "found([bob,cid])")
    team.up("pi3")
    look.until(lambda look: "cid/agentd" in look.alive(), "cid is back")
    look.believes("ann", "found([bob,cid])")
