"""Synchronous asks between agents of a mission: answered, timed out, and not mixed up with late answers."""

from pathlib import Path

from tests.agentd.daemons import daemons, end, mission, printed
from tests.support.processes import running

ANSWERS = """\
v(7).
+?twice(X, Y) <- Y = X * 2.
+?never(_) <- .wait(never).
+?late(X) <- .wait(12000); X = 1; .print("late").
"""
ASKS = """\
!go.
+late(_) <- .print("not here").
+!go
   <- .send(b, askOne, v(_), v(X)); .print("v ", X); .send(b, askOne, twice(4, _), T); .print(T);
      .send(b, askAll, v(_), L); .print(L); .send(b, askOne, none, N); .print(N);
      .send(b, askHow, { +?twice(_, _) }, P); .length(P, K); .print(K, " plan");
      .send(b, askOne, late(_), W, 1000); .print("limit ", W);
      .send(b, askOne, never(_), F); .print("default ", F);
      .send([a,b], askOne, v(_), Vs, 30000); .sort(Vs, Sorted); .print(Sorted);
      .send(b, askOne, v(_)); .wait(v(7)[source(b)]); .print("end").
"""


def test_questions_are_answered_or_time_out_after_thirty_mission_seconds(tmp_path: Path, endpoint: str) -> None:
    text = "mission: asks\nspeed: 10\nagents:\n  a: {program: a.asl}\n  b: {program: b.asl}\ndone: 'a: never'\n"
    path = mission(tmp_path, text, a=ASKS, b=ANSWERS)
    with daemons(path, endpoint, "b") as (b,):
        b.says("agents=b")  # a question waits for 3 s here, and a busy machine takes its time to start another daemon
        with running("agentd", "serve", path, "a", "--router", endpoint) as a:
            a.says("[a] end")
            b.says("[b] late")
            end(a, b)
    assert printed(a) == [
        "[a] v 7",
        "[a] twice(4,8)[source(b)]",
        "[a] [v(7)[source(b)]]",
        "[a] false",
        "[a] 1 plan",
        "[a] limit timeout",
        "[a] default timeout",
        "[a] [false,v(7)[source(b)]]",
        "[a] end",
    ]
