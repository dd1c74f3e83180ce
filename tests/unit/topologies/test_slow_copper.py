"""A slow classical channel: what `tc` is given, and the message on a kernel without it."""

import subprocess
from types import SimpleNamespace
from typing import Any

import pytest

from topologies.links.slow_copper import slow_metadata
from topologies.system.processes.programs import NetworkError
from wire.metadata.header import METADATA_PORT


def host(commands: list[str], program: str) -> Any:
    """Return a host that notes commands, and runs another program."""

    def popen(command: list[str]) -> "subprocess.Popen[bytes]":
        commands.append(" ".join(command))
        return subprocess.Popen(["sh", "-c", program], stderr=subprocess.PIPE)

    return SimpleNamespace(name="alice", defaultIntf=lambda: "alice-eth0", popen=popen)


def test_metadata_has_a_rate_of_the_network_and_all_else_another_class() -> None:
    """tc-tbf(8): the rate is that of the wall, on which a second of the network takes 5."""
    commands: list[str] = []
    slow_metadata(host(commands, "true"), 10.0, 5.0)
    (bucket,) = (command for command in commands if "tbf" in command)
    assert bucket.startswith("tc qdisc add dev alice-eth0 parent 1:2 handle 2: tbf rate 2000000bit")
    filters = [command for command in commands if "u32" in command]
    assert len(filters) == 2
    for end, command in zip(("sport", "dport"), filters, strict=True):
        assert f"match ip {end} {METADATA_PORT} 0xffff flowid 1:2" in command
    assert "htb default 1" in commands[0]


def test_a_kernel_without_it_is_named() -> None:
    with pytest.raises(NetworkError, match=r"alice: tc .*: no such kind; .* sch_tbf"):
        slow_metadata(host([], "echo no such kind >&2; false"), 10.0, 1.0)
