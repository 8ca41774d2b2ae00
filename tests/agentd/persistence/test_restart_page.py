"""docs/guides/restart.md: its program is one, and its figures are those of the code."""

from pathlib import Path

from agentd.language.compiler.compile import compile_program
from agentd.language.parse import parse_program
from agentd.mail import outbox
from agentd.mind import Mind
from agentd.persistence import checkpointer, group_commit
from agentd.runtime import action_client
from commd.client import actions, receive_once, send_mail
from commd.liveness import presence

PAGE = (Path(__file__).parents[3] / "docs/guides/restart.md").read_text()


def test_the_program_of_the_page_can_be_run() -> None:
    (source,) = PAGE.split("```")[1::2]
    source = source.removeprefix("asl")
    mind = Mind("uav", compile_program(parse_program(source, "page.asl")))
    for _ in range(20):
        mind.step(0.0)
    assert "leg(1)[source(self)]" in [belief.text for belief in mind.belief_views()]


def test_the_figures_of_the_page_are_those_of_the_code() -> None:
    said = {
        f"for at most {action_client.ANSWER_PATIENCE:g} s in all",
        f"for {checkpointer.ACTION_PATIENCE:g} s at most",
        f"nothing, for {actions.BUS_GRACE:g} s",
        f"back within {presence.AGENT_GRACE:g} s",
        f"at most {1 / checkpointer.MAIL_EVERY:g} times a second, {1 / group_commit.PAUSE_MOST:g} on a slow disk",
        f"at most {1 / checkpointer.NEAR_EVERY:g} times a second",
        f"at the latest after {checkpointer.BUSY_PATIENCE:g} s",
        f"{outbox.MOST_FOR_ONE:,} messages to this receiver, or {outbox.MOST_BYTES // 2**20} MB",
        f"more than {send_mail.LARGEST // 2**20} MB encoded",
    }
    assert [one for one in said if one not in PAGE] == []
    assert 1 / checkpointer.OTHERS_EVERY == 2
    assert receive_once.NUMBERINGS == 1_000
