"""Agents made at run time, files and services under `agentd serve`: a real bus, real daemons."""

from pathlib import Path

import pytest

from agentd.extensions.file_access import MOST_SAVED, AgentFiles, NotAllowed, state_folder
from agentd.runtime.agent_group import MOST_MADE
from tests.agentd.daemons import daemons, end, mission, printed
from tests.support.processes import running

ONE = "mission: one\nagents:\n  a: {program: a.asl}\ndone: 'a: never'\n"
TWO = "mission: two\nagents:\n  a: {program: a.asl}\n  b: {program: b.asl}\ndone: 'a: never'\n"
KID = """\
!born.
+!born <- .my_name(N); .print("born ", N); .send(a, tell, born(N)).
+toy(X)[source(S)] <- .my_name(N); .print("has ", X, " of ", S); .send(S, tell, thanks(N, X)).
+?age(X) <- X = 7.
"""


def prints(path: str, endpoint: str, *arguments: str, last: str = "[a] end") -> list[str]:
    """Run agent `a` of a mission beside a router until it has said its last words; return what was printed."""
    with daemons(path, endpoint, arguments) as (agent,):
        agent.says(last)
        end(agent)
    return printed(agent)


MAKES = """\
!go.
+!go
   <- .create_agent(kid, "kid.asl"); .wait(born(kid)); .create_agent(kid, "kid.asl"); .wait(born(kid_1));
      .create_agent(Helper, "kid.asl"); .print("helper ", Helper); .wait(born(helper));
      .all_names(L); .print("names ", L);
      .send(kid, tell, toy(ball)); .wait(thanks(kid, ball));
      .send(kid_1, askOne, age(_), A); .print("age ", A);
      .broadcast(tell, toy(rope)); .wait(thanks(kid, rope) & thanks(kid_1, rope) & thanks(helper, rope));
      .kill_agent(kid); .all_names(L2); .print("now ", L2); !t(1);
      -born(kid)[source(kid)]; .create_agent(kid, "kid.asl"); .wait(born(kid)); .all_names(L3); .print("again ", L3);
      .create_agent(own); .all_names(L4); .print("empty ", L4); .print("end").
+!t(1) <- .send(kid, tell, toy(doll)); .print("not here").
-!t(N)[error(E), error_msg(M)] <- .print(N, " ", E, " ", M).
"""


def test_agents_are_made_talked_to_asked_ended_and_made_again(tmp_path: Path, endpoint: str) -> None:
    told = prints(mission(tmp_path, ONE, a=MAKES, kid=KID), endpoint)
    assert [line for line in told if line.startswith("[a]")] == [
        "[a] helper helper",
        "[a] names [a,kid,kid_1,helper]",
        "[a] age age(7)[source(kid_1)]",
        "[a] now [a,kid_1,helper]",
        "[a] 1 receiver_not_found there is no agent 'kid' to send to",
        "[a] again [a,kid_1,helper,kid]",
        "[a] empty [a,kid_1,helper,kid,own]",
        "[a] end",
    ]
    assert told.count("[kid] born kid") == 2
    assert "[helper] has rope of a" in told


REFUSED = """\
!go.
+!go <- for (.range(I, 1, 8)) { !t(I) }; .print("end").
+!t(1) <- .kill_agent(nobody).
+!t(2) <- .kill_agent(a).
+!t(3) <- .create_agent(bad, "missing.asl").
+!t(4) <- .create_agent(bad, "../outside.asl").
+!t(5) <- .create_agent(bad, "link.asl").
+!t(6) <- .create_agent("no name", "kid.asl").
+!t(7) <- .create_agent(bad, "wrong.asl").
+!t(8) <- for (.range(_, 1, 60)) { .create_agent(kid, "quiet.asl") }.
-!t(8)[error(E), error_msg(M)] <- .all_names(L); .length(L, N); .print(8, " ", E, " ", M, ", there are ", N).
-!t(N)[error(E), error_msg(M)] <- .print(N, " ", E, " ", M).
"""


def test_what_cannot_be_made_or_ended_fails_with_the_reason(tmp_path: Path, endpoint: str) -> None:
    (tmp_path / "outside.asl").write_text(KID)
    folder = tmp_path / "m"
    folder.mkdir()
    (folder / "link.asl").symlink_to(tmp_path / "outside.asl")
    path = mission(folder, ONE, a=REFUSED, kid=KID, wrong="!go", quiet="")
    told = prints(path, endpoint, "--state", str(tmp_path / "state"))
    places = f"{folder} and {tmp_path}/state/one/a"
    assert [line for line in told if line.startswith("[a]") and not line.startswith("[a]    ")] == [  # no excerpts
        "[a] 1 ia_failed there is no agent 'nobody'",
        "[a] 2 action_failed 'a' is an agent of the mission: "
        "only those made at run time can be killed; .stopMAS ends all",
        f"[a] 3 unknown there is no file missing.asl in {places.replace(' and ', ', ')}",
        f"[a] 4 unknown ../outside.asl is outside of {places}",
        f"[a] 5 unknown link.asl is outside of {places}",
        "[a] 6 unknown Expected a name of letters, digits, `_`, `-` or `.` that starts with a letter (a-z, A-Z), "
        "got `no name`",
        next(line for line in told if line.startswith(f"[a] 7 unknown {folder}/wrong.asl:1:4: error: ")),
        f"[a] 8 unknown this daemon takes at most {MOST_MADE} agents made at run time, there are {MOST_MADE + 1}",
        "[a] end",
    ]


KEEPS = """\
colour(red).
twice(X, Y) :- Y = X * 2.
!go.
+!go
   <- +note("say \\"hi\\""); .clone("twin"); .send(twin, achieve, show); .wait(shown(twin));
      .save_agent("kept/self.asl", [begin]); .include("kept/self.asl", copy); ?copy::note(X); .print("copy ", X);
      .create_agent(child, "kept/self.asl"); .wait(begun(child)); !t(1); !t(2); !t(3); .print("end").
+!show[source(S)] <- .my_name(N); ?colour(C); ?twice(4, T); .print(C, " ", T); .send(S, tell, shown(N)).
+!begin <- .my_name(N); .send(a, tell, begun(N)).
+!t(1) <- .save_agent("../escaped.asl").
+!t(2) <- .include("../m.yaml").
+!t(3) <- .include("missing.asl"); .print("a missing file is no failure").
-!t(N)[error(E), error_msg(M)] <- .print(N, " ", E, " ", M).
"""


def test_an_agent_is_cloned_saved_and_included_below_its_folders_only(tmp_path: Path, endpoint: str) -> None:
    folder, state = tmp_path / "m", tmp_path / "state"
    folder.mkdir()
    told = prints(mission(folder, ONE, a=KEEPS), endpoint, "--state", str(state))
    assert told == [
        "[twin] red 8",
        '[a] copy say "hi"',
        f"[a] 1 unknown ../escaped.asl is outside of {state}/one/a, where agents save",
        f"[a] 2 unknown ../m.yaml is outside of {folder} and {state}/one/a",
        "[a] a missing file is no failure",
        "[a] end",
    ]
    assert (state / "one/a/kept/self.asl").is_file()
    assert not (state / "escaped.asl").exists()


SERVES = """\
!go.
+!go
   <- .df_register(cook); .df_subscribe("bake"); .create_agent(baker, "baker.asl");
      .wait(provider(baker, P)[source(df)]); .print(P);
      .df_search("cook", L); .df_search(bake, L2); .print(L, L2);
      .kill_agent(baker); .df_search(bake, L3); .df_deregister(cook); .df_search(cook, L4); .print(L3, L4);
      .print("end").
"""


def test_services_are_found_within_one_daemon(tmp_path: Path, endpoint: str) -> None:
    path = mission(tmp_path, ONE, a=SERVES, baker="!go. +!go <- .df_register(bake).\n")
    assert prints(path, endpoint) == ["[a] bake", "[a] [a][baker]", "[a] [][]", "[a] end"]


def test_services_of_another_daemon_are_found_and_reported(tmp_path: Path, endpoint: str) -> None:
    a = """\
!go.
+!go <- .df_subscribe(cook); .wait(provider(b, "cook")[source(df)]); .df_search(cook, L); .print(L);
   .send(b, tell, enough); .wait(stopped[source(b)]); .df_search(cook, L2); .print(L2); .print("end").
"""
    b = "!go. +!go <- .df_register(cook). +enough[source(S)] <- .df_deregister(cook); .send(S, tell, stopped).\n"
    path = mission(tmp_path, TWO, a=a, b=b)
    with daemons(path, endpoint, "a", "b") as (first, _):
        first.says("[a] end")
        assert printed(first) == ["[a] [b]", "[a] []", "[a] end"]


def test_an_agent_that_starts_fresh_offers_nothing_of_its_former_life(tmp_path: Path, endpoint: str) -> None:
    path = mission(tmp_path, TWO, a="!go. +!go <- .df_register(cook).\n", b="")
    path_b = "!go. +!go : true <- .df_search(cook, L); .print(L); .wait(300); !go.\n"
    (tmp_path / "b.asl").write_text(path_b)
    with daemons(path, endpoint, "b") as (watcher,):
        with running("agentd", "serve", path, "a", "--router", endpoint):
            watcher.says("[b] [a]")
        (tmp_path / "a.asl").write_text("")
        watcher.lines.clear()
        with running("agentd", "serve", path, "a", "--fresh", "--router", endpoint):
            watcher.says("[b] []")


@pytest.mark.parametrize("path", ["../x", "/etc/passwd", "a/../../x", ""])
def test_nothing_is_saved_outside_of_the_folder_of_state(tmp_path: Path, path: str) -> None:
    files = AgentFiles([tmp_path / "m"], tmp_path / "state")
    with pytest.raises(NotAllowed, match="where agents save"):
        files.save(path, "p.")
    assert not (tmp_path / "state").exists()


@pytest.mark.parametrize("path", ["kept_in", "./kept_in"])
def test_nothing_is_saved_over_what_the_agent_is_kept_in(tmp_path: Path, path: str) -> None:
    with pytest.raises(NotAllowed, match="where the agent itself is kept"):
        AgentFiles([tmp_path], tmp_path / "state").save(path, "p.")


def test_what_is_saved_is_there_whole_can_be_read_again_and_is_bounded(tmp_path: Path) -> None:
    files = AgentFiles([tmp_path / "m"], tmp_path / "state")
    files.save("a/b.asl", "p.")
    files.save("a/b.asl", "q.")
    assert files.readable("a/b.asl", str(tmp_path / "m" / "x.asl")).read_text() == "q."
    assert [f.name for f in (tmp_path / "state/a").iterdir()] == ["b.asl"]
    with pytest.raises(NotAllowed, match="more than may be saved"):
        files.save("c.asl", "x" * (MOST_SAVED + 1))


def test_the_state_is_where_it_was_asked_for_or_systemd_or_the_user_keep_it(monkeypatch: pytest.MonkeyPatch) -> None:
    assert state_folder("/srv/x", "sar") == Path("/srv/x/sar")
    monkeypatch.setenv("STATE_DIRECTORY", "/var/lib/argosy:/var/lib/other")
    assert state_folder(None, "sar") == Path("/var/lib/argosy/sar")
    monkeypatch.delenv("STATE_DIRECTORY")
    monkeypatch.setenv("XDG_STATE_HOME", "/home/u/.state")
    assert state_folder(None, "sar") == Path("/home/u/.state/argosy/sar")


def test_a_file_that_is_a_link_to_itself_is_not_found(tmp_path: Path) -> None:
    (tmp_path / "loop.asl").symlink_to("loop.asl")
    with pytest.raises(FileNotFoundError, match="there is no file loop"):
        AgentFiles([tmp_path], tmp_path / "state").readable("loop.asl", str(tmp_path / "a.asl"))
