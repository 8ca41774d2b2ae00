"""`argosy replay --mind`: minds of a recorded trial live again; and what damaged recordings prove."""

import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import msgspec
import pytest

from argosy.__main__ import main
from argosy.recording.metadata import End
from argosy.recording.mind_inputs import RecordedMind
from argosy.recording.reader import BadRecording, Recording
from argosy.recording.records import TokenSeen
from argosy.recording.write_queue import Heard
from argosy.recording.writer import RecordingWriter
from argosy.trial.faults import Kill
from schemas.wire.codec import codec
from schemas.wire.mind_records import MindInputs
from tests.argosy.recording.recorders import tried

MISSION = """\
mission: lamp
agents:
  seller: {program: seller.asl}
  buyer: {program: buyer.asl, beliefs: [limit(5)]}
done: ["seller: mission_done"]
timeout: 60s
"""
SELLER = """\
price(8).
!sell.
+!sell : price(P) <- .send(buyer, achieve, offer(lamp, P)).
+refused(Item, P)[source(Who)] <- .print(Who, " says no to ", P); .wait(400); -+price(P - 1); !sell.
+sold(Item, P) <- .print("sold for ", P); +mission_done.
"""
BUYER = """\
@take +!offer(Item, P)[source(Who)] : limit(Most) & P <= Most <- .random(Luck); .send(Who, tell, sold(Item, P)).
@leave +!offer(Item, P)[source(Who)] <- .print(P, " is too much"); .send(Who, tell, refused(Item, P)).
"""
AGREES = re.compile(
    r"(\w+)(?: with \S+)?: agrees: \d+ cycles, \d+ inputs?, (\d+) decisions, (\d+) effects up to [\d.]+ s of mission "
    r"time, in [\d.]+ s\n"
)


@dataclass(frozen=True)
class Recorded:
    """A recording of the sale, in a folder with its programs."""

    path: Path

    def edited(self, name: str, old: str, new: str) -> Path:
        """Return a program of it with a change."""
        text = (self.path.parent / name).read_text(encoding="utf-8")
        assert text.count(old) == 1
        (path := self.path.parent / "edited" / name).parent.mkdir(exist_ok=True)
        path.write_text(text.replace(old, new), encoding="utf-8")
        return path

    def changed(
        self,
        name: str,
        change: Callable[[MindInputs], MindInputs | None],
        *,
        stays: bool = False,
        again: bool = False,
        twice: str = "",
    ) -> Path:
        """Return a copy in which the buyer's inputs are changed; None leaves them out.

        `stays`: the buyer does not leave; `again`: another daemon of it comes at the end; `twice`: all is there once
        more, as of another fleet.
        """
        recording, path = Recording(self.path), self.path.with_name(name)
        writer = RecordingWriter(path, recording.facts, overwrite=True)
        for message in recording.messages():
            data: bytes | None = message.data
            record = message.record
            if isinstance(record, MindInputs) and record.agent == "buyer":
                changed = change(record)
                data = None if changed is None else codec(MindInputs).encode(changed)
            if isinstance(record, TokenSeen) and "/buyer/" in record.key and not record.alive and data is not None:
                data = None if stays else data
                if again:
                    seen = msgspec.structs.replace(record, key=f"{record.key}9", alive=True)
                    writer.add(Heard(message.at, message.key, message.data, message.track.encoding, "put"))
                    data = msgspec.json.encode(seen)
            for key in {message.key, message.key.replace("/lamp/", f"/{twice}/") if twice else message.key}:
                if data is not None:
                    writer.add(Heard(message.at, key, data, message.track.encoding, "put"))
            writer.flush()
        writer.close(End("done", recording.last))
        return path


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """Record the sale in virtual time."""
    folder = tmp_path_factory.mktemp("sale")
    for name, text in (("lamp.yaml", MISSION), ("seller.asl", SELLER), ("buyer.asl", BUYER)):
        (folder / name).write_text(text, encoding="utf-8")
    assert tried(folder / "lamp.yaml", folder / "lamp.mcap").success
    return Recorded(folder / "lamp.mcap")


@pytest.fixture
def replayed(
    recorded: Recorded, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> Callable[..., tuple[int, str, str]]:
    """Return what replays a mind: exit code, output and errors."""
    monkeypatch.chdir(recorded.path.parent)

    def replay(agent: str, *more: str | Path, path: Path | str = "lamp.mcap") -> tuple[int, str, str]:
        code = main(["replay", str(path), "--mind", agent, *map(str, more)])
        said = capsys.readouterr()
        return code, said.out, said.err

    return replay


Replay = Callable[..., tuple[int, str, str]]


def test_both_minds_of_a_run_decide_the_same_again(replayed: Replay) -> None:
    for agent in ("seller", "buyer"):
        code, out, err = replayed(agent)
        assert (code, err) == (0, "")
        found = AGREES.fullmatch(out)
        assert found is not None, out
        assert found[1] == agent
        assert int(found[2]) >= 4  # at 8, 7, 6 and 5
        assert int(found[3]) >= 4


def test_an_edited_program_shows_its_first_other_decision_with_what_came_in_and_what_follows(
    recorded: Recorded, replayed: Replay
) -> None:
    path = recorded.edited("buyer.asl", "P <= Most", "P < Most")
    code, out, _ = replayed("buyer", "--program", "edited/buyer.asl")
    assert code == 1
    head, rest = out.split("recorded:\n")
    before, after = rest.split("edited:\n")
    assert head.startswith("buyer: differs: the same for ")
    assert "achieve offer(lamp,5) from seller\n" in head
    assert ", 0 inputs" not in head
    assert "chosen: @take +!offer(Item,P)[source(Who)] (buyer.asl:1), with Item = lamp, P = 5" in before
    assert re.search(r"then\n +[\d.]+ s  send tell sold\(lamp,5\)", before)
    assert f"not @take +!offer(Item,P)[source(Who)] ({path.relative_to(recorded.path.parent)}:1): P < Most " in after
    assert "chosen: @leave" in after
    assert "print 5 is too much" in after
    assert "refused(lamp,5)" in after


def test_an_edit_that_changes_no_decision_agrees(recorded: Recorded, replayed: Replay) -> None:
    recorded.edited("buyer.asl", "@take ", "// for as much as it has\n\n@take ")
    code, out, _ = replayed("buyer", "--program", "edited/buyer.asl")
    assert code == 0
    assert AGREES.fullmatch(out)
    assert out.startswith("buyer with edited/buyer.asl: agrees: ")


def test_another_effect_of_the_same_decision_is_a_difference(recorded: Recorded, replayed: Replay) -> None:
    recorded.edited("buyer.asl", '.print(P, " is too much")', '.print("too dear")')
    code, out, _ = replayed("buyer", "--program", "edited/buyer.asl")
    assert code == 1
    before, after = out.split("recorded:")[1].split("edited:")
    assert "print 8 is too much\n" in before
    assert "print too dear\n" in after
    code, out, _ = replayed("buyer", "--program", "edited/buyer.asl", "--show", "0")
    assert code == 1
    assert "then\n" not in out


def test_decisions_about_a_name_are_told_up_to_a_time(replayed: Replay) -> None:
    code, out, _ = replayed("buyer", "--why", "offer")
    assert code == 0
    assert len(re.findall(r"^ +[\d.]+ s  \+!offer\(lamp,\d\)", out, re.MULTILINE)) == 4
    assert "not @take +!offer(Item,P)[source(Who)] (buyer.asl:1): P <= Most does not hold" in out
    code, out, _ = replayed("buyer", "--why", "offer", "--until", "0.7")
    assert code == 0
    assert 1 <= out.count("+!offer(lamp,") <= 3


Change = Callable[[MindInputs], MindInputs | None]


def without(which: Callable[[MindInputs], bool]) -> Change:
    """Return a change that leaves out some of the inputs."""
    return lambda batch: None if which(batch) else batch


def born(**fields: object) -> Change:
    """Return a change of what a mind began with."""

    def change(batch: MindInputs) -> MindInputs:
        if batch.initial is None:
            return batch
        return msgspec.structs.replace(batch, initial=msgspec.structs.replace(batch.initial, **fields))

    return change


FINAL = without(lambda batch: batch.final)
PROVES: dict[str, tuple[Change, dict[str, bool], int, list[str]]] = {
    "a batch is missing": (without(lambda batch: batch.number == 2), {}, 1, [
        "buyer: the same for ", "but not all of it is proved:\n  batch 2 of its inputs is missing\n",
    ]),
    "it ended before the agent": (FINAL, {"stays": True}, 0, [
        "buyer: agrees as far as the recording goes: ", "  note: the recording ends before the agent does\n",
    ]),
    "it ended sooner, and a batch is missing": (without(lambda batch: batch.number == 1), {"stays": True}, 1, [
        "batch 1 of its inputs is missing",
    ]),
    "it ended as the next life began": (FINAL, {"again": True}, 1, [
        "its end is not in the recording: it was killed",
    ]),
    "it began too late": (without(lambda batch: batch.number == 0), {}, 1, [
        "buyer: nothing can be proved\n  its start is missing, with batch 0 of its inputs: begin to record sooner\n",
    ]),
    "nobody listened": (lambda batch: msgspec.structs.replace(batch, digest="", decided=0), {}, 1, [
        "its decisions had no subscriber in ",
    ]),
    "it could not be recorded": (born(unknown="it is a clone"), {}, 1, [
        "buyer: nothing can be proved\n", "it is a clone",
    ]),
}  # fmt: skip
"""What is changed in a recording, how else, the exit code of its replay, and what that says."""


@pytest.mark.parametrize("what", PROVES)
def test_what_a_recording_proves_of_which(what: str, recorded: Recorded, replayed: Replay) -> None:
    change, how, expected, told = PROVES[what]
    code, out, _ = replayed("buyer", path=recorded.changed("changed.mcap", change, **how))
    assert (code, "agrees" in out) == (expected, expected == 0)
    assert all(text in out for text in told), out


def test_what_was_changed_in_the_recording_is_found(recorded: Recorded, replayed: Replay) -> None:
    """The digest of what was decided does not fit any more: the recorded decision is shown beside the other one."""
    code, out, _ = replayed("buyer", path=recorded.changed("other.mcap", born(beliefs=("limit(9)",))))
    assert code == 1
    assert "agrees" not in out
    assert out.startswith("buyer: differs: the same for ")
    assert "recorded:\n" in out
    assert "chosen: @leave" in out.split("recorded:\n")[1].split("now:\n")[0]
    assert "chosen: @take" in out.split("now:\n")[1]


def test_a_life_whose_end_is_missing_does_not_agree_although_its_daemon_was_seen_to_go(
    recorded: Recorded, replayed: Replay, capsys: pytest.CaptureFixture[str]
) -> None:
    path = recorded.changed("tail.mcap", lambda batch: None if batch.final else batch)
    code, out, _ = replayed("buyer", path=path)
    assert code == 1
    assert out.startswith("buyer: the same for ")
    assert out.endswith(
        "but not all of it is proved:\n  its end is not in the recording: it was killed, or its last inputs were lost\n"
    )
    assert main(["replay", str(path), "--info"]) == 0
    out = capsys.readouterr().out
    assert re.search(r"^  seller +\w+ +whole, ", out, re.MULTILINE)
    lines = r"^  buyer +\w+ +from its start to [\d.]+ s of mission time, its end is missing, "
    assert re.search(lines, out, re.MULTILINE)


def test_inputs_that_this_version_cannot_read_are_told_and_never_agree(recorded: Recorded, replayed: Replay) -> None:
    recording, one, all_of_them = Recording(recorded.path), "one.mcap", "all.mcap"
    for name in (one, all_of_them):
        writer = RecordingWriter(recorded.path.with_name(name), recording.facts, overwrite=True)
        for message in recording.messages():
            data = message.data
            if message.key.endswith("buyer/trace/inputs") and (name == all_of_them or b'"number":2' in data):
                data = b'{"number": "two"}'
            writer.add(Heard(message.at, message.key, data, message.track.encoding, "put"))
        writer.close(End("done", recording.last))
    code, out, _ = replayed("buyer", path=one)
    assert code == 1
    assert "agrees" not in out
    assert "1 batch of its inputs cannot be read: another version of Argosy wrote them" in out
    code, out, err = replayed("buyer", path=all_of_them)
    assert (code, out) == (2, "")
    assert err.startswith("error: all.mcap: no inputs of buyer can be read: another version of Argosy")


def cut_off(recorded: Recorded, good: Callable[[RecordedMind], bool]) -> Path:
    """Return the longest beginning of the file, itself aside, that has such a mind of the buyer; written as it came."""
    chunks = recorded.changed("chunks.mcap", lambda batch: batch)
    whole, cut = chunks.read_bytes(), recorded.path.with_name("cut.mcap")
    for size in range(len(whole) - 1000, 1000, -500):
        cut.write_bytes(whole[:size])
        with suppress(BadRecording):
            if any(good(life) for life in Recording(cut).minds("buyer")):
                return cut
    raise AssertionError("there is no such beginning")


def test_a_life_that_ended_before_the_file_was_cut_off_agrees(recorded: Recorded, replayed: Replay) -> None:
    code, out, err = replayed("buyer", path=cut_off(recorded, lambda life: life.whole and life.ended))
    assert code == 0
    assert AGREES.fullmatch(out)
    assert err.startswith("warning: ")


def test_a_file_cut_off_is_proved_as_far_as_it_goes_and_does_not_agree(recorded: Recorded, replayed: Replay) -> None:
    cut = cut_off(recorded, lambda life: life.whole and not life.ended)
    code, out, err = replayed("buyer", path=cut)
    assert code == 1
    assert "agrees" not in out
    assert err.startswith("warning: ")
    assert "cut off" in out or "missing" in out
    told = replayed("buyer", "--until", "1000", path=cut)
    assert (told[0], told[1].split(", in ")[0]) == (1, out.split(", in ")[0])


@pytest.mark.parametrize("second", ["nan", "-1", "soon"])
def test_what_is_no_mission_second_is_refused(second: str, capsys: pytest.CaptureFixture[str]) -> None:
    for command in (["replay", "x.mcap", "--mind", "uav", "--until"], ["why", "uav", "--recording", "x.mcap", "--at"]):
        with pytest.raises(SystemExit, match="2"):
            main([*command, second])
        assert f"expected a mission second, 0 or more, got `{second}`" in capsys.readouterr().err


def test_what_was_asked_for_in_part_agrees_in_part(recorded: Recorded, replayed: Replay) -> None:
    last = max(batch.number for batch in Recording(recorded.path).minds("buyer")[0].batches)
    path = recorded.changed("gap.mcap", lambda batch: None if batch.number == last - 1 else batch)
    code, out, _ = replayed("buyer", "--until", "0.1", path=path)
    assert code == 0
    assert out.startswith("buyer: agrees up to second 0.1, as asked: ")


def test_nothing_is_told_of_an_edited_program_where_the_recorded_one_does_not_live_as_it_was_recorded(
    recorded: Recorded, replayed: Replay
) -> None:
    def another(batch: MindInputs) -> MindInputs:
        return msgspec.structs.replace(batch, digest="0" * 24) if batch.number == 1 else batch

    path = recorded.changed("tampered.mcap", another)
    code, out, _ = replayed("buyer", "--program", "buyer.asl", path=path)
    assert code == 1
    assert "agrees" not in out
    assert out.startswith("buyer: differs: ")
    assert out.endswith("  this is the recorded program itself: buyer.asl cannot be compared with it\n")


def test_one_of_several_fleets_has_to_be_named(recorded: Recorded, replayed: Replay) -> None:
    path = recorded.changed("fleets.mcap", lambda batch: batch, twice="other")
    code, out, err = replayed("buyer", path=path)
    assert (code, out) == (2, "")
    assert err == f"error: {path}: buyer is in several fleets: add --fleet lamp or other\n"
    for fleet in ("lamp", "other"):
        code, out, _ = replayed("buyer", "--fleet", fleet, path=path)
        assert code == 0
        assert AGREES.fullmatch(out)
    code, _, err = replayed("buyer", "--fleet", "third", path=path)
    assert code == 2
    assert "there are no inputs of buyer of fleet third in it" in err


def test_it_is_said_which_file_an_edited_one_of_another_name_replaces(recorded: Recorded, replayed: Replay) -> None:
    def with_an_include(batch: MindInputs) -> MindInputs:
        if batch.initial is None:
            return batch
        files = {**batch.initial.files, str(Path(batch.initial.program).with_name("flying.asl")): "height(3).\n"}
        return msgspec.structs.replace(batch, initial=msgspec.structs.replace(batch.initial, files=files))

    several = recorded.changed("several.mcap", with_an_include)
    (recorded.path.parent / "flyin.asl").write_text(BUYER, encoding="utf-8")
    code, out, err = replayed("buyer", "--program", "flyin.asl", path=several)
    assert (code, out.startswith("buyer with flyin.asl: agrees: ")) == (0, True), out
    known = "no recorded file is called flyin.asl, there are buyer.asl, flying.asl"
    assert err == f"note: flyin.asl takes the place of buyer.asl: {known}\n"
    (recorded.path.parent / "flying.asl").write_text("height(4).\n", encoding="utf-8")
    assert replayed("buyer", "--program", "flying.asl", path=several)[2] == ""
    assert replayed("buyer", "--program", "flyin.asl")[2] == "", "there is but one file that it can be meant for"


@pytest.mark.parametrize(
    "option", ["--info", "--json", "--loop", "--force", "--speed 2", "--from 1", "--to 2", "--only uav/**"]
)
def test_options_that_have_no_meaning_for_a_mind_are_refused(option: str, replayed: Replay) -> None:
    code, out, err = replayed("buyer", *option.split())
    assert (code, out) == (2, "")
    assert err == f"error: {option.split()[0]}: not with --mind, which publishes nothing\n"


@pytest.mark.parametrize("option", ["--program buyer.asl", "--start 1", "--until 2", "--why offer", "--show 1"])
def test_options_that_have_a_meaning_for_a_mind_only_are_refused_without(
    option: str, recorded: Recorded, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["replay", str(recorded.path), *option.split()]) == 2
    assert capsys.readouterr().err == f"error: {option.split()[0]}: only with --mind AGENT\n"


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["nobody"], "error: lamp.mcap: there are no inputs of nobody in it, there are those of buyer, seller"),
        (["buyer", "--start", "2"], "error: lamp.mcap: --start 2: buyer has 1 start in it"),
        (["buyer", "--program", "none.asl"], "error: none.asl: No such file or directory"),
        (["buyer", "--program", "lamp.yaml"], "lamp.yaml: error: expected a program in AgentSpeak; "),
        (["buyer", "--program", "lamp.mcap"], "lamp.mcap: error: expected a program in AgentSpeak; "),
    ],
)
def test_what_is_not_there_is_named(arguments: list[str], told: str, replayed: Replay) -> None:
    code, out, err = replayed(*arguments)
    assert (code, out) == (2, "")
    assert err.startswith(told)


def test_a_file_that_is_no_recording_is_refused(recorded: Recorded, replayed: Replay) -> None:
    code, out, err = replayed("buyer", path="lamp.yaml")
    assert (code, out) == (2, "")
    assert err == "error: lamp.yaml: not an MCAP file: missions are for `argosy run`\n"


COUNT = """\
mission: count
agents:
  counter: {program: counter.asl}
done: ["counter: enough"]
timeout: 60s
restart: on-failure
"""
COUNTER = """\
count(0).
!go.
+restarted(_) <- !go.
+!go : count(N) & N >= 8 <- +enough.
+!go : count(N) <- -+count(N + 1); .random(Luck); .print("at ", N, ", ", Luck); .wait(500); !go.
"""


def test_a_mind_that_was_killed_and_came_back_is_proved_but_for_the_end_of_its_first_life(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "count.yaml").write_text(COUNT, encoding="utf-8")
    (tmp_path / "counter.asl").write_text(COUNTER, encoding="utf-8")
    assert tried(tmp_path / "count.yaml", tmp_path / "count.mcap", Kill(at=2.5, daemon="agentd")).success
    assert main(["replay", str(tmp_path / "count.mcap"), "--mind", "counter"]) == 1
    lines = capfd.readouterr().out.splitlines(keepends=True)
    assert lines[0].startswith("counter: the same for ")
    assert lines[0].endswith("but not all of it is proved:\n")
    assert lines[1].startswith("  its end is not in the recording: it was killed, ")
    assert AGREES.fullmatch(lines[2].replace(", start 2", ""))
    file = str(tmp_path / "count.mcap")
    assert main(["replay", file, "--mind", "counter", "--start", "2", "--why", "restarted"]) == 0
    assert "+restarted(1)" in capfd.readouterr().out
    assert main(["why", "counter", "restarted", "--recording", str(tmp_path / "count.mcap")]) == 0
    said = capfd.readouterr().out
    assert "restarted(1) " in said
    assert "is raised by agentd in a restarted agent." in said
    assert "stands in the program" not in said
