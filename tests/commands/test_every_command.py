"""Every command of docs, run as it stands there: it ends as its page says, in minutes.

Those of the README and the walkthrough, with their outputs, are in tests/emulation.
"""

import os
import re
import shlex
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import takewhile
from pathlib import Path

import netqasm.examples.apps
import pytest
from documentation import NAMES, ROOT, blocks, shell, tshark, without_numbers

pytestmark = pytest.mark.timeout(3600)

OF_COURSE = [name for name in NAMES if name.startswith("course/")]  # test_course.py
ELSEWHERE = ("README.md", "docs/walkthrough.md", *OF_COURSE)
OF_A_NETWORK_THAT_RUNS = ("devices", "paths", "keys", "set", "send", "enter")
OF_A_NETWORK_OR_A_RUN = ("spy", "live")
UNTIL_CTRL_C = re.compile(r"qmn (live|spy(?! runs)|run keys(?!.*--seconds)|enter tcpdump)")
SECONDS = 20  # of these
MININET = "sudo PYTHONPATH=. mn "
PROMPTS = ("qmn> ", "mininet> ")
# Commands that ask a network from another terminal, and that network; and the address it prints
# where the page has one of another day.
BESIDE = {
    r"pygnmicli ": "qmn cli sdc --gnmi",
    r'curl -s -H "\$token" ': "qmn cli sdc --rest 127.0.0.1:8080",
    r"curl .*:PORT/metrics": "qmn cli sdc --metrics",
}
OF_ANOTHER_DAY = re.compile(r"127\.0\.0\.1:(20114|PORT)")
ADDRESS = re.compile(r"(?:gNMI|metrics) of .*?(127\.0\.0\.1:\d+)")
RUN = re.compile(rf"qmn |tshark |{re.escape(MININET)}|{'|'.join(BESIDE)}")
BEFORE = re.compile(r"(export )?[A-Za-z]+=|cd ")
SERVER = re.compile(r"sudo (\.venv/bin/python -m dispatcher\.sabot --socket (\S+)) &")
# It stays as long as what is typed below it, which waits here until it listens.
SERVED = r"""(cd ROOT; exec \1) &
trap "kill $!" EXIT
until test -S \2; do sleep 0.1; done"""
PRINTED = re.compile(r"bob: hello$|identical: ")  # by the line above
# Commands that nothing here runs, and why not: a line that neither is nor is run is refused.
NOT_HERE = {
    r"make |\.ci/run": "CI's own: tests/unit/qmn/test_pages.py looks for the targets",
    r"docker/run |docker swarm |docker stack |QMN_LIVE_PORT=8123 docker/run ": (
        "needs Docker: .ci/run, tests/image and tests/swarm"
    ),
    r"\.venv/bin/dask |bin/qmn worker |ssh root@|bin/qmn run sdc --machines 2 ": (
        "needs a second machine: tests/emulation/test_several_machines.py"
    ),
    r"tshark .*/machines\.keys": (
        "needs what passes between machines: tests/emulation/test_several_machines.py"
    ),
    r"\.venv/bin/python examples/standing_light\.py": "tests/emulation/test_own_controller.py",
    r"curl -s (\$add|127\.0\.0\.1:8080/stats/)": "tests/emulation/test_switch_swaps.py",
    r"qmn cli (sdc --switch q1\.analysers=1|chain,.*ofctl_rest)": (
        "tests/emulation/test_switch_swaps.py"
    ),
    r"(add|ask|emit|frame)(\(\)| 409)|for q in|ovs-ofctl .* add-flow q1 in_port": (
        "tests/emulation/test_switch_swaps.py"
    ),
    r"qmn> .* swap 9": "tests/emulation/test_switch_swaps.py",
    r"qmn enter ovs-vsctl set": "takes c0 from the network that other commands share",
    rf"{re.escape(MININET)}.*light=standing": "tests/emulation/test_own_controller.py",
    r"qmn enter --run ": "tests/emulation/test_own_namespaces.py, with two runs",
    r"qmn netqasm bell ": "tests/unit/applications/test_bundled_applications.py",
    r"cat > bell\.qasm|qmn .*bell\.qasm": "tests/unit/qmn/test_pages.py, with that file",
    r"sudo service openvswitch-switch start": "set-up: `qmn` itself looks for Open vSwitch",
    r"apt install \./qmn_|python3 -m venv ~/qmn|(sudo )?~/qmn/bin/": (
        "needs a machine without a checkout: tests/emulation/test_installed_wheel.py"
    ),
    r"sudo env .*jupyter lab ": "tests/emulation/test_notebooks.py",
    r"xdg-open ": "needs a display: tests/unit/views/test_report_in_browser.py",
    r"python examples/tags|head -c 2000 |qmn run sdc --file zeros|qmn .*time-tags/played\.py": (
        "tests/emulation/test_run_tags.py, with such runs"
    ),
    r"(chopper2|timeout 4 chopper|pfind|costream|splicer) ": "needs qcrypto, which is not ours",
    r"python3 -m venv /tmp/sequence|/tmp/sequence/bin/": "needs SeQUeNCe, which is not ours",
}
PLACEHOLDERS = {"COPY": "copy", "RUN": "runs/first"}
ELSEWHERE_ONLY = re.compile(r"qmn runs(?= import)")  # what is here cannot be imported


@dataclass(frozen=True)
class Typed:
    """A line of a page."""

    page: str
    line: str
    before: tuple[str, ...] = ()  # variables that its block sets, and the folder that it goes to
    answers: tuple[str, ...] = ()  # what is typed at the prompt of the program
    printed: tuple[str, ...] = ()  # what its page shows of its output

    @property
    def verb(self) -> str:
        """Return the word behind `qmn`."""
        program, verb = self.line.split()[:2]
        return verb if program == "qmn" else ""

    @property
    def beside(self) -> str | None:
        """Return the network that has to run for a program that is none of ours."""
        return next((net for each, net in BESIDE.items() if re.match(each, self.line)), None)

    @property
    def needs_network(self) -> bool:
        """Whether a network has to run."""
        of_both = self.verb in OF_A_NETWORK_OR_A_RUN and "runs/" not in self.line
        return self.verb in OF_A_NETWORK_THAT_RUNS or of_both


def lines_of(block: str) -> Iterator[str]:
    """Yield the lines of a block, each whole: with what continues it, or what it reads."""
    whole = re.sub(r"<<'(\w+)'\n.*?^\1$", "", block, flags=re.MULTILINE | re.DOTALL)
    for line in whole.replace("\\\n", " ").splitlines():
        yield re.sub(r"^sudo bin/", "", line)


def excused(line: str) -> bool:
    """Return whether others run a line, or nobody can."""
    return any(re.match(each, line) for each in NOT_HERE)


def typed(page: str) -> Iterator[Typed]:
    """Yield the commands of a page; raise ValueError for a line that is no known one."""
    for block in blocks(page):
        before: list[str] = []
        found: list[Typed] = []
        if block.startswith("tshark "):  # where the reader went for the block before
            before.append("cd runs/latest")
        skipped = False
        for line in lines_of(block):
            if excused(line):
                skipped = True
            elif SERVER.match(line):
                before.append(SERVER.sub(SERVED, line).replace("ROOT", str(ROOT)))
            elif BEFORE.match(line):
                before.append(line.replace(".venv/bin/python", str(ROOT / ".venv/bin/python")))
            elif RUN.match(line):
                skipped = False
                found.append(Typed(page, line, tuple(before)))
            elif line.startswith(PROMPTS) and (skipped or found):
                if not skipped:
                    answer = line.partition("> ")[2]
                    found[-1] = replace(found[-1], answers=(*found[-1].answers, answer))
            elif PRINTED.match(line) and found:
                found[-1] = replace(found[-1], printed=(*found[-1].printed, line))
            else:
                raise ValueError(f"{page}: {line!r}: neither a known command nor excused")
        yield from found


EVERY = [each for page in NAMES if page not in ELSEWHERE for each in typed(page)]
ASKING = [each for each in EVERY if each.beside is not None]
LINES = [each for each in EVERY if each.beside is None]


def test_each_excuse_is_needed() -> None:
    every = [line for page in NAMES for block in blocks(page) for line in lines_of(block)]
    for each in NOT_HERE:
        assert any(re.match(each, line) for line in every), each


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return where a reader works, who has had runs before."""
    made = tmp_path_factory.mktemp("work")
    for own in ("docs", "examples"):
        (made / own).symlink_to(ROOT / own)
    (made / "my-app").symlink_to(Path(netqasm.examples.apps.__file__).with_name("teleport"))
    (made / "big.bin").write_bytes(bytes(100_000))
    (made / "commands.txt").write_text("alice qsend bob hello\n")
    for _run in range(2):
        done = shell("qmn run sdc --depolarizing 0.001 --frame-bytes 32 --qasm --tls", made)
        assert done.returncode == 0, done.stderr
    first = min((made / "runs").glob("2*"))
    (made / "runs" / "first").symlink_to(first.name)
    return made


@contextmanager
def running(command: str, folder: Path, first: str = "") -> Iterator[str]:
    """Have a network that runs until the end of the block; yield what it has printed."""
    pipe = subprocess.PIPE
    path = f"{ROOT / 'bin'}:{os.environ['PATH']}"
    with subprocess.Popen(
        [*shlex.split(command), "--runs", str(folder / "others")],
        stdin=pipe,
        stdout=pipe,
        text=True,
        env={**os.environ, "PATH": path},
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(f"{first}sh echo ready\n")
        process.stdin.flush()
        printed = list(takewhile(lambda line: "ready" not in line, process.stdout))
        assert process.poll() is None, printed
        yield "".join(printed)
        process.stdin.write("exit\n")
        process.stdin.close()
        process.stdout.read()


@pytest.fixture
def network(folder: Path) -> Iterator[None]:
    """Have a network that runs, and has sent something."""
    command = "qmn cli sdc --captures full --device bob.compensator.retarders=3"
    with running(command, folder, "alice qsend bob hello\n") as printed:
        assert "bob: hello" in printed
        yield


def script(command: Typed) -> str:
    """Return the commands for a shell."""
    line = re.sub(r"\b(COPY|RUN)\b", lambda found: PLACEHOLDERS[found[0]], command.line)
    line = ELSEWHERE_ONLY.sub("qmn runs --runs elsewhere", line)
    if UNTIL_CTRL_C.match(line):
        line = f"timeout --preserve-status --signal=INT {SECONDS} {line}"
    line = re.sub(r"^tshark", tshark(), line).removeprefix("sudo ")
    line = line.replace("pygnmicli", str(ROOT / ".venv/bin/pygnmicli"))
    # Root does without: tests/emulation/test_rootless.py has an ordinary user.
    line = line.replace("qmn rootless ", "qmn ")
    before = [
        each.replace("runs/latest", "runs/first").replace("sudo ", "") for each in command.before
    ]
    return "\n".join([*before, line])


@pytest.mark.parametrize("command", LINES, ids=lambda each: f"{each.page}: {each.line}")
def test_a_command_of_a_page_ends_as_it_says(
    folder: Path, command: Typed, request: pytest.FixtureRequest
) -> None:
    if command.needs_network:
        request.getfixturevalue("network")
    text = script(command)
    where = ROOT if command.line.startswith(MININET) else folder
    typed_to_it = "\n".join([*command.answers, "exit", ""]).replace("/tmp/got", str(folder / "got"))
    done = shell(text, where, typed=typed_to_it)
    statuses = {0}
    if UNTIL_CTRL_C.match(command.line):
        statuses = {0, 130}
    elif "no key" in command.line.partition("#")[2]:
        statuses = {1}
    output = done.stdout + done.stderr
    assert done.returncode in statuses, done.stdout[-3000:] + done.stderr[-3000:]
    assert "Traceback" not in output
    for each in command.printed:
        assert without_numbers(each) in without_numbers(output), output


@pytest.mark.parametrize("command", ASKING, ids=lambda each: f"{each.page}: {each.line}")
def test_a_program_that_asks_a_network_gets_an_answer(folder: Path, command: Typed) -> None:
    assert command.beside is not None
    with running(command.beside, folder) as printed:
        text = script(command)
        if OF_ANOTHER_DAY.search(text):
            address = ADDRESS.search(printed)
            assert address is not None, printed
            text = OF_ANOTHER_DAY.sub(address[1], text)
        done = shell(text, folder)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    assert done.stdout.strip()
    assert "Traceback" not in done.stdout + done.stderr
