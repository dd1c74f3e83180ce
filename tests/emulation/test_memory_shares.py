"""The memory that programs of a host may take, and the groups that a run takes away again."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import wait_until
from fabric_scene import running
from limits import SOON_S
from loaded import run_qmn
from mininet.node import Node

from topologies.nodes import ClassicalHost
from topologies.sdc import SdcTopo
from topologies.system.kernel.memory_share import groups_of_gone, parent
from topologies.system.processes import owners

pytestmark = pytest.mark.image

MIB = 128
NONE = "this machine lets nobody make groups of processes that share memory"
TAKE = "import sys, time; kept = bytearray(int(sys.argv[1]) << 20); print('has it'); time.sleep(60)"


class LittleMemoryTopo(SdcTopo):
    """One more host, with little memory."""

    def build(self, **parameters: object) -> None:
        """Add it to the others."""
        super().build(**parameters)
        dave = self.addHost("dave", cls=ClassicalHost, memory_mib=MIB)
        self.addLink(dave, "s1")


@pytest.fixture(scope="module")
def dave(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Node]:
    """Yield the host."""
    with running(LittleMemoryTopo, tmp_path_factory.mktemp("memory")) as network:
        yield network.host("dave")
    assert groups() == []


def groups() -> list[Path]:
    """Return those of this process's networks; beside it others may have a host of this name."""
    below, ours = parent(), f"qmn.{owners.namespace()}.*.dave"
    return sorted(below[0].glob(ours)) if below else []


def take(dave: Node, mib: int) -> "subprocess.Popen[str]":
    """Start a program that takes so much memory and keeps it."""
    command = [sys.executable, "-c", TAKE, str(mib)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    started: subprocess.Popen[str] = dave.popen(command, **pipes)
    return started


def end(program: "subprocess.Popen[str]") -> None:
    with program:
        program.kill()


def output(program: "subprocess.Popen[str]") -> str:
    assert program.stdout is not None
    return program.stdout.readline().strip()


def test_a_program_has_what_is_below_the_limit(dave: Node) -> None:
    program = take(dave, MIB // 2)
    assert output(program) == "has it"
    end(program)


def test_a_program_is_refused_more(dave: Node) -> None:
    program = take(dave, 2 * MIB)
    output, _ = program.communicate(timeout=SOON_S)
    assert program.returncode == 1
    assert output.splitlines()[-1] == "MemoryError"


def test_what_is_typed_is_refused_more(dave: Node) -> None:
    assert "MemoryError" in dave.cmd(f'{sys.executable} -c "bytearray({2 * MIB} << 20)"')


def test_nobody_on_the_host_raises_the_limit(dave: Node) -> None:
    assert dave.cmd("ulimit -Hd").strip() == str(MIB * 1024)
    assert "Operation not permitted" in dave.cmd("ulimit -d unlimited")


def test_several_together_do_not_take_more(dave: Node) -> None:
    if parent() is None:
        pytest.skip(NONE)
    programs = [take(dave, MIB // 2) for _ in range(4)]

    def killed() -> bool:
        return any(program.poll() == -9 for program in programs)

    wait_until(killed, "one is killed")
    for program in programs:
        end(program)


def test_who_takes_more_does_not_go_on_by_swapping(dave: Node) -> None:
    """Linux documents it: version 1 limits memory and swap together, version 2 swap alone."""
    below = parent()
    if below is None:
        pytest.skip(NONE)
    (group,) = groups()
    swap = group / below[1].swap
    if not swap.exists():
        pytest.skip("this kernel counts no swap")
    assert int(swap.read_text()) == {"memory.memsw.limit_in_bytes": MIB << 20}.get(swap.name, 0)


def test_what_a_killed_run_leaves_goes_with_the_next(tmp_path: Path) -> None:
    below = parent()
    if below is None:
        pytest.skip(NONE)
    ended = owners.this_process()._replace(start=1)
    left = below[0] / f"qmn.{owners.namespace()}.{ended}.erin"
    left.mkdir()
    assert left in groups_of_gone()
    script = tmp_path / "nothing.py"
    script.touch()
    assert run_qmn("script", str(script)).returncode == 0
    assert not left.exists()
