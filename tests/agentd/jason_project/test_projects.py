"""Project files of Jason: read, run, and told about where they cannot be."""

from pathlib import Path

import pytest

from agentd.jason_project.project_parser import Project, parse_project
from agentd.language.syntax_tree.errors import SyntaxErrors
from tests.agentd.conftest import Command, Ran
from tests.agentd.mistakes import mistakes


def _parse(text: str) -> Project:
    return parse_project(text, "team.mas2j")


@pytest.fixture
def run(command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Write files, run the first of them from another folder than its own."""
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")

    def run(files: dict[str, str], *arguments: str) -> Ran:
        written = {f"home/{name}": text for name, text in files.items()}
        return command(written, "run", f"../{next(iter(written))}", "--exit-when-idle", *arguments)

    return run


EVERYTHING = """
// a comment
MAS search_team {
    /* another
       comment */
    infrastructure: Centralised

    environment: env.Field(10, "very fast", [a,b]) at "far.example.org"
    executionControl: jason.control.Slow
    agents:
        bob;
        ann people/ann.asl [beliefs="likes(bob), name(\\"Ann\\")", goals="greet", verbose=2]
            agentArchClass my.Radio, my.Eyes(3) agentClass my.Agent beliefBaseClass my.Beliefs("x") #3 at far;
        eve "with blanks/eve.asl" #2 [events=discard];
        out ../other/out.asl;
        jar $jasonJar/agents/jar.asl;
    aslSourcePath: "src/asl"; lib;
    classpath: "lib/*.jar"; "x.jar";
    directives: sand = my.Sand; rock = my.Rock(2);
}
"""


def test_everything_that_a_project_file_may_say_is_read() -> None:
    project = _parse(EVERYTHING)
    assert (project.name, project.file) == ("search_team", "team.mas2j")
    assert project.infrastructure.name == "Centralised"
    assert (project.environment.name, project.environment.arguments) == ("env.Field", ("10", "very fast", "[a,b]"))
    assert project.environment_host.text == "far.example.org"
    assert project.control is not None
    assert [path.text for path in project.source_paths] == ["src/asl", "lib"]
    assert [path.text for path in project.class_paths] == ["lib/*.jar", "x.jar"]
    assert [(name.text, spec.name) for name, spec in project.directives] == [("sand", "my.Sand"), ("rock", "my.Rock")]
    bob, ann, eve, out, jar = project.agents
    assert (bob.name, bob.file, bob.count) == ("bob", None, 1)
    assert (ann.file.text, ann.count) == ("people/ann.asl", 3)
    assert [(o.name, o.value) for o in ann.options] == [
        ("beliefs", 'likes(bob), name("Ann")'),
        ("goals", "greet"),
        ("verbose", "2"),
    ]
    assert [spec.name for spec in ann.architectures] == ["my.Radio", "my.Eyes"]
    assert ann.agent_class is not None
    assert ann.belief_base.arguments == ("x",)
    assert ann.host is not None
    assert str(ann.position) == "team.mas2j:12:9"
    assert (eve.file.text, eve.count) == ("with blanks/eve.asl", 2)
    assert [entry.file.text for entry in (out, jar) if entry.file] == ["../other/out.asl", "$jasonJar/agents/jar.asl"]


def test_sections_may_stand_in_any_order() -> None:
    project = _parse('mas x { aslSourcePath: "a"; agents: bob; infrastructure: Local }')
    assert [entry.name for entry in project.agents] == ["bob"]


BAD = mistakes("projects.txt")


@pytest.mark.parametrize(("text", "place", "message"), BAD)
def test_a_bad_project_file_is_reported_with_its_place(text: str, place: str, message: str) -> None:
    with pytest.raises(SyntaxErrors) as told:
        _parse(text)
    (finding,) = told.value.findings
    assert (finding.file, f"{finding.line}:{finding.column}", finding.message) == ("team.mas2j", place, message)


def test_the_errors_of_several_agents_are_reported_together() -> None:
    with pytest.raises(SyntaxErrors) as told:
        _parse("MAS x { agents: a #x; b; c [y]; d agentClass; }")
    assert [finding.column for finding in told.value.findings] == [20, 30, 45]


def test_the_source_path_may_begin_with_a_name_that_is_mapped(run) -> None:
    project = {"team.mas2j": 'MAS t { agents: bob; aslSourcePath: "$jasonJar/inc"; }'}
    told = run({**project, "../elsewhere/jar/inc/bob.asl": HELLO}, "--map", "$jasonJar=jar")
    assert (told.code, told.lines, told.err) == (0, ["[bob] hi"], "")
    told = run(project)
    assert told.code == 2
    assert "cannot read bob.asl" in told.err
    assert "warning: aslSourcePath: nothing says which folder $jasonJar is; give --map '$jasonJar=FOLDER'" in told.err


def test_the_source_path_begins_at_the_projects_folder_and_at_the_working_folder(run) -> None:
    files = {"team.mas2j": 'MAS t { agents: bob; ann; aslSourcePath: "own"; }', "own/bob.asl": HELLO}
    told = run({**files, "../elsewhere/own/ann.asl": HELLO})
    assert (told.code, sorted(told.lines), told.err) == (0, ["[ann] hi", "[bob] hi"], "")


def test_all_that_is_wrong_with_the_programs_of_a_project_is_reported_together(run) -> None:
    told = run({"team.mas2j": "MAS t { agents: bad; gone; worse; }", "bad.asl": "!a <- .", "worse.asl": "+!a <- ; ."})
    assert told.code == 2
    assert told.err.count(": error:") == 3


HELLO = "!hi. +!hi : .my_name(N) <- .print(hi)."


def test_a_project_is_run_with_numbered_agents_beliefs_and_goals(run) -> None:
    told = run(
        {
            "team.mas2j": """MAS team { agents:
                bob #3;
                ann people/ann.asl [beliefs="likes(bob),name(\\"Ann\\")[nice]", goals="greet,wait_for(3)"];
            }""",
            "bob.asl": HELLO,
            "people/ann.asl": "+!greet : likes(X) & name(N)[nice] <- .print(N, X). +!wait_for(N) <- .print(N).",
        }
    )
    assert (told.code, told.err) == (0, "")
    assert sorted(told.lines) == ["[ann] 3", "[ann] Annbob", "[bob1] hi", "[bob2] hi", "[bob3] hi"]


def test_programs_and_what_they_include_are_found_on_the_source_path_and_in_the_usual_folders(run) -> None:
    told = run(
        {
            "team.mas2j": 'MAS team { agents: ann; bob; eve; aslSourcePath: "programs"; }',
            "programs/ann.asl": '{ include("common.asl") } ' + HELLO,
            "programs/bob.asl": '!b. +!b <- .create_agent(kid, "kid.asl").',
            "programs/lib/unused.asl": "",
            "src/agt/eve.asl": HELLO,
            "src/agt/inc/common.asl": "!common. +!common <- .print(common).",
            "programs/kid.asl": HELLO,
        }
    )
    assert (told.code, told.err) == (0, "")
    assert sorted(told.lines) == ["[ann] common", "[ann] hi", "[eve] hi", "[kid] hi"]


def test_verbose_is_what_the_internal_action_would_set(run) -> None:
    program = "!s. +!s <- .log(fine, detail); .print(said)."
    told = run(
        {
            "team.mas2j": "MAS t { agents: quiet a.asl [verbose=0]; usual a.asl; loud a.asl [verbose=2]; }",
            "a.asl": program,
        }
    )
    assert sorted(told.lines) == ["[loud] detail", "[loud] said", "[usual] said", "said"]


JAVA = """MAS team {
    infrastructure: Jade
    environment: my.World(7, "x")
    agents: bob agentArchClass my.Arch, jason.architecture.AgArch agentClass my.Agent
                beliefBaseClass jason.bb.TextPersistentBB("f") at "pi1"
                [events=requeue, gui=yes];
    aslSourcePath: "nowhere";
    classpath: "a.jar"; "b.jar";
    directives: sand = my.Sand;
}
"""


def test_what_is_java_is_named_and_the_agents_run_without(run) -> None:
    told = run({"team.mas2j": JAVA, "bob.asl": HELLO + " +!later <- my.pkg.act(1); my.pkg.act(2)."})
    assert (told.code, told.lines) == (0, ["[bob] hi"])
    assert [line.partition("/home/")[2] for line in told.err.splitlines()] == [
        "bob.asl:1:51: warning: nothing provides the internal action my.pkg.act/1: write its Java class in Python",
        "team.mas2j:2:21: warning: the infrastructure Jade is not supported: all agents run in this process",
        "team.mas2j:3:18: warning: the Java environment my.World is not supported: "
        "actions will fail, and nothing is perceived; write it in Python and give --env module:Class",
        "team.mas2j:4:32: warning: the Java architecture of the agent bob, my.Arch is not supported: "
        "it has the usual one",
        "team.mas2j:4:78: warning: the Java class of the agent bob, my.Agent is not supported: it reasons as usual",
        "team.mas2j:5:33: warning: the Java belief base of the agent bob, jason.bb.TextPersistentBB is not supported: "
        "beliefs are kept in memory only",
        "team.mas2j:5:67: warning: at pi1 is not supported: the agent bob runs in this process",
        "team.mas2j:6:18: warning: the option events=requeue of the agent bob has no effect here",
        "team.mas2j:6:34: warning: the option gui=yes of the agent bob has no effect here",
        "team.mas2j:7:20: warning: aslSourcePath: there is no folder ../home/nowhere",
        "team.mas2j:8:16: warning: the classpath is not used: there is no Java here",
        "team.mas2j:9:24: warning: the directive sand of the Java class my.Sand is not supported: "
        "a program that uses it cannot be run",
    ]


def test_an_agent_that_uses_a_directive_of_java_cannot_run(run) -> None:
    told = run({"team.mas2j": JAVA, "bob.asl": "{ sand(3) }\n" + HELLO})
    assert told.code == 2
    assert told.lines == []
    message = "bob.asl:1:1: error: there is no directive { sand }; its Java class my.Sand cannot be used here"
    assert message in told.err, told.err


def test_a_python_environment_takes_the_place_of_the_java_one_with_its_arguments(run, tmp_path: Path) -> None:
    (tmp_path / "elsewhere" / "the_world.py").write_text(
        "from agentd import Environment, literal\n"
        "class World(Environment):\n"
        "    def init(self, arguments):\n"
        "        self.add_percept(literal('given', *arguments))\n"
    )
    project = JAVA.replace("classpath", "//")
    told = run({"team.mas2j": project, "bob.asl": "+given(A,B) <- .print(A, B)."}, "--env", "the_world.py:World")
    assert told.lines == ["[bob] 7x"]
    assert "environment" not in told.err


@pytest.mark.parametrize(
    ("project", "told"),
    [
        (
            "MAS t { agents: bob; gone; }",
            ":1:22: error: cannot read gone.asl, the program of the agent gone: No such file or directory\n",
        ),
        ('MAS t { agents: bob [beliefs="a(1"]; }', ":1:22: error: beliefs: "),
        ('MAS t { agents: bob [beliefs="3"]; }', 'beliefs="3": expected literals with commas between them'),
        ('MAS t { agents: bob [goals="X > 1"]; }', ":1:22: error: goals: a comparison as an element"),
        ("MAS t { agents: bob [verbose=7]; }", ":1:22: error: verbose must be 0, 1 or 2, not 7"),
        ("MAS t { agents: bob; bob; }", ":1:22: error: there is already an agent bob, in line 1"),
        ("MAS t { agents: bob #2; bob2 bob.asl; }", ":1:25: error: there is already an agent bob2, in line 1"),
        ("MAS t { agents: bob $jasonJar/bob.asl; }", "nothing says which folder $jasonJar is; give --map"),
        ("MAS t { agents bob; }", "team.mas2j:1:9: error: a ':' is missing after agents\n"),
        ("MAS t { agents: bad; }", "bad.asl:1:12: error:"),
    ],
)
def test_a_project_that_cannot_be_run_is_reported_and_ends_with_two(run, project: str, told: str) -> None:
    ran = run({"team.mas2j": project, "bob.asl": HELLO, "bad.asl": "!s. +!s <- ; ."})
    assert (ran.code, ran.lines) == (2, [])
    assert told in ran.err


def test_a_project_file_that_is_not_there_or_not_alone_is_reported(command: Command) -> None:
    alone = "error: a project file is run alone: it names its agents\n"
    assert command({}, "run", "team.mas2j", "bob.asl") == Ran(2, "", alone)
    gone = "gone.mas2j: error: cannot read the project: No such file or directory\n"
    assert command({}, "run", "gone.mas2j") == Ran(2, "", gone)
