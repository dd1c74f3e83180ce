"""The command line as a whole: which verbs there are, and that each loads what it needs alone."""

import re
import subprocess
import sys

import pytest
from limits import SOON_S

from qmn.__main__ import HEADINGS, VERBS, described
from qmn.parser import Parser

LOADED = """
import sys
from qmn.__main__ import described
words = sys.argv[1:]
described(words).format_help()
heavy = {"grpc", "mininet.node", "networkx", "numpy", "rich", "ryu", "scipy", "tornado"}
print(*sorted(heavy & sys.modules.keys()))
"""


@pytest.mark.parametrize("verb", VERBS)
def test_a_verb_is_what_its_module_is_called(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        described([verb]).parse_args([verb, "--help"])
    assert ended.value.code == 0
    assert capsys.readouterr().out.startswith(f"usage: qmn {verb} ")


@pytest.mark.parametrize("words", [[], ["--help"], ["sudoku"]])
def test_without_a_verb_all_are_told(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    parser = described(words)
    with pytest.raises(SystemExit):
        parser.parse_args(words)
    report = parser.format_help().partition("options:")[0]
    assert re.findall(r"^  (\w+) ", report, re.MULTILINE) == [*VERBS]
    if words == ["sudoku"]:
        assert "VERB 'sudoku': choose one of run, cli, script" in capsys.readouterr().err


def test_verbs_are_listed_under_what_somebody_wants_to_do() -> None:
    report = described().format_help()
    for title, verbs in HEADINGS.items():
        listed = report.partition(f"\n{title}:\n")[2].partition("\n\n")[0]
        assert [line.split()[0] for line in listed.splitlines()] == [*verbs]
        assert all(len(line.split()) > 2 for line in listed.splitlines())  # what it does, too
    assert len(set(VERBS)) == len(VERBS)
    assert f"\n{'  --version':<14}print name and version, and end\n" in report


@pytest.mark.parametrize(
    ("word", "needed"), [("--help", set()), ("--version", set()), ("devices", {"rich"})]
)
def test_help_and_a_verb_do_not_wait_for_what_others_load(word: str, needed: set[str]) -> None:
    command = [sys.executable, "-c", LOADED, word]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=SOON_S)
    assert set(done.stdout.split()) <= needed


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (
            ["run", "sdc", "--mesage", "hi"],
            "qmn run sdc: error: there is no --mesage: did you mean --message? "
            "(`qmn run sdc --help-all` lists all)",
        ),
        (
            ["devices", "--xyzzy=3"],
            "qmn devices: error: there is no --xyzzy (`qmn devices --help` lists all)",
        ),
        (
            ["set", "policy", "relaod"],
            "qmn set policy: error: reload 'relaod': did you mean reload? "
            "(`qmn set policy --help` lists all)",
        ),
        (
            ["run", "sdc", "--captures", "som"],
            "qmn run sdc: error: --captures 'som': choose one of full, headers, none "
            "(`qmn run sdc --help-all` lists all)",
        ),
        (
            ["run", "sdc", "--seed", "1.5"],
            "qmn run sdc: error: --seed '1.5': choose a whole number "
            "(`qmn run sdc --help-all` lists all)",
        ),
        (
            ["run", "sdc", "hello"],
            "qmn run sdc: error: unexpected argument 'hello' (`qmn run sdc --help-all` lists all)",
        ),
    ],
)
def test_a_slip_is_one_line_of_the_verb_with_what_is_near(
    words: list[str], text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        described(words).parse_args(words)
    assert ended.value.code == 2
    assert capsys.readouterr().err == f"{text}\n"


@pytest.mark.parametrize(("text", "whole"), [("1e6", 1_000_000), ("2.0", 2), ("-3", -3)])
def test_a_whole_number_may_have_a_point_or_an_exponent(text: str, whole: int) -> None:
    parser = Parser()
    parser.add_argument("--number", type=int)
    number = parser.parse_args([f"--number={text}"]).number
    assert (number, type(number)) == (whole, int)


def test_a_percentage_is_answered_by_the_number_that_it_is(
    capsys: pytest.CaptureFixture[str],
) -> None:
    parser = Parser()
    parser.add_argument("--share", type=float)
    with pytest.raises(SystemExit):
        parser.parse_args(["--share=2%"])
    assert "--share '2%': choose a number: write 0.02 (" in capsys.readouterr().err


def test_the_options_of_a_run_are_in_groups(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        described(["run"]).parse_args(["run", "sdc", "--help-all"])
    output = capsys.readouterr().out
    assert output.startswith("usage: qmn run sdc [options]\n")
    titles = ["options", "the job", "the network", "light and noise", "time and simulation"]
    titles += ["copper and control", "what is written and served", "several machines"]
    assert re.findall(r"^(\S.*):$", output, re.MULTILINE) == titles
    assert "--message" in output[output.index("the job:") : output.index("the network:")]
    assert (
        "--copper-km"
        in output[output.index("copper and control:") : output.index("what is written")]
    )


@pytest.mark.parametrize("job", ["sdc", "teleport", "swap", "qkd", "keys", "load"])
def test_help_has_the_options_that_matter(job: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        described(["run"]).parse_args(["run", job, "--help"])
    output = capsys.readouterr().out
    options = set(re.findall(r"^  (--[a-z-]+)", output, re.MULTILINE)) - {"--help-all"}
    assert {"--topology", "--preset", "--length-km", "--seed", "--live"} < options
    assert 8 <= len(options) <= 13
    assert re.search(rf"^\d+ more options: qmn run {job} --help-all$", output, re.MULTILINE)


@pytest.mark.parametrize("text", ["1.5", "1e", "inf", "nan", "2%"])
def test_what_is_not_whole_is_refused(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    parser = Parser()
    parser.add_argument("--number", type=int)
    with pytest.raises(SystemExit):
        parser.parse_args([f"--number={text}"])
    assert f"--number '{text}': choose a whole number" in capsys.readouterr().err
