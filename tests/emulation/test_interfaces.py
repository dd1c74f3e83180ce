"""Interfaces that go together, in the kernel of this machine."""

import os
import socket
import subprocess
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from conftest import interfaces
from limits import wait_until

from topologies.system.kernel.interfaces import (
    await_end,
    delete,
    hardware_address,
    make_pair,
    network_of,
)
from topologies.system.processes.commands import ip
from topologies.system.processes.programs import NetworkError

PAIRS = 3


@pytest.fixture
def pairs() -> Iterator[list[tuple[str, str]]]:
    """Make pairs of interfaces, of which the last is not ours."""
    made = [(f"s8-eth{number}", f"s9-eth{number}") for number in range(1, PAIRS + 1)]
    ip(f"link add {one} type veth peer name {other}" for one, other in made)
    yield made
    left = [one for one, _other in made if one in interfaces()]
    ip(f"link delete {name}" for name in left)


def groups() -> dict[str, str]:
    """Return the group of each interface, of which 0 is that of all that nobody puts into one."""
    lines = subprocess.check_output(["ip", "-oneline", "link"], text=True).splitlines()
    words = [line.split() for line in lines]
    return {each[1].partition("@")[0].rstrip(":"): each[each.index("group") + 1] for each in words}


def test_those_that_are_named_go_with_their_peers_and_no_other(
    pairs: list[tuple[str, str]],
) -> None:
    (first, _), both, foreign = pairs
    before = groups()
    delete(first, *both, "s8-eth99")  # an end, both ends, and what is not there
    assert interfaces() == before.keys() - {*pairs[0], *both}
    assert groups() == {name: group for name, group in before.items() if name in interfaces()}
    assert set(foreign) < interfaces()


def test_what_does_not_go_by_itself_is_deleted(pairs: list[tuple[str, str]]) -> None:
    ours = {name for pair in pairs[:-1] for name in pair}
    await_end({*ours, "s8-eth99"})
    assert interfaces() & ours == set()
    assert set(pairs[-1]) < interfaces()


def test_what_the_kernel_does_not_delete_is_told() -> None:
    with pytest.raises(NetworkError, match=r"^cannot delete lo: Operation not supported$"):
        delete("lo")
    assert groups()["lo"] == "default"


def names() -> set[str]:
    """Return the interfaces of the network that this thread is in."""
    return {name for _number, name in socket.if_nameindex()}


@pytest.fixture
def elsewhere() -> Iterator[Any]:
    """Give a node in a network of its own."""
    with subprocess.Popen(["unshare", "--net", "sleep", "600"]) as process:
        here = os.readlink("/proc/self/ns/net")
        there = Path(f"/proc/{process.pid}/ns/net")
        wait_until(lambda: os.readlink(there) != here, "the node has a network of its own")
        yield SimpleNamespace(name="elsewhere", pid=process.pid, inNamespace=True)
        process.kill()


def test_each_end_of_a_pair_is_at_its_node_and_has_its_address(elsewhere: Any) -> None:
    here: Any = SimpleNamespace(name="here", pid=os.getpid(), inNamespace=False)
    before = interfaces()
    with network_of(elsewhere):
        empty = names()
    one, other = ("s8-eth1", "02:00:00:00:00:08", here), ("h9-eth1", "02:00:00:00:00:09", elsewhere)
    for first, second in ((one, other), (other, one)):
        make_pair([first, second])
        assert interfaces() == before | {one[0]}
        assert hardware_address(one[0]) == one[1]
        with network_of(elsewhere):
            assert names() == empty | {other[0]}
            assert hardware_address(other[0]) == other[1]
        with pytest.raises(NetworkError, match="make the link s8-eth1 to h9-eth2: File exists"):
            make_pair([one, ("h9-eth2", None, elsewhere)])
        delete(one[0])
        with network_of(elsewhere):
            assert names() == empty
