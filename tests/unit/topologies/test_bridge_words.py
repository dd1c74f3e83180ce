"""Bridges as ovs-vsctl itself makes them, without looking anything up."""

import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from limits import SOON_S

from topologies.nodes.classical_switch import bridge_words

SCHEMA = "/usr/share/openvswitch/vswitch.ovsschema"
COLUMNS = {
    "Open_vSwitch": "bridges",
    "Bridge": "name,ports,fail_mode,protocols,other_config,external_ids",
    "Port": "name,interfaces",
    "Interface": "name,type,ofport_request",
}
OPTIONS = ["fail_mode=secure", "protocols=OpenFlow14", "other_config:datapath-id=1001"]
PORTS = {"q1-eth1": ["ofport_request=1"], "q1-eth7": ["ofport_request=7"]}
LOOKED_UP = {"add-br", "add-port", "set", "get", "list", "find", "remove"}  # by name or condition
DUMP = "ovsdb-client", "-f", "csv", "dump"


@pytest.fixture
def database(tmp_path: Path) -> Iterator[str]:
    """Yield the socket of a database of Open vSwitch that no switch reads."""
    file, socket = tmp_path / "conf.db", tmp_path / "db.sock"
    subprocess.run(["ovsdb-tool", "create", file, SCHEMA], check=True, timeout=SOON_S)
    words = ["--unixctl", str(tmp_path / "ctl"), f"--remote=punix:{socket}", str(file)]
    server = subprocess.Popen(["ovsdb-server", *words], stderr=subprocess.DEVNULL)
    try:
        report = f"unix:{socket}"
        ovs("ovsdb-client", "--timeout=20", "wait", report, "Open_vSwitch", "connected")
        vsctl(report, "init")
        yield report
    finally:
        server.kill()
        server.wait()


def ovs(*words: str) -> str:
    """Return what a program of Open vSwitch says."""
    return subprocess.run(words, check=True, capture_output=True, text=True, timeout=SOON_S).stdout


def vsctl(database: str, *words: str) -> None:
    ovs("ovs-vsctl", f"--db={database}", "--no-wait", *words)


def contents(database: str) -> dict[str, list[str]]:
    """Return the rows of all tables, with as many references as there are in each."""
    return {
        table: sorted(
            re.sub(r"[0-9a-f]{8}-[0-9a-f-]{27}", "row", line)
            for line in ovs(
                *DUMP, database, "Open_vSwitch", table, *columns.split(",")
            ).splitlines()
        )
        for table, columns in COLUMNS.items()
    }


def test_a_bridge_is_as_add_br_and_add_port_make_it(database: str) -> None:
    words = ["add-br", "q1", "--", "set", "bridge", "q1", *OPTIONS]
    for name, columns in PORTS.items():
        words += ["--", "add-port", "q1", name, "--", "set", "Interface", name, *columns]
    vsctl(database, *words)
    expected = contents(database)
    vsctl(database, "del-br", "q1", "--", *bridge_words("q1", OPTIONS, PORTS))
    assert contents(database) == expected


def test_a_bridge_that_is_there_is_replaced(database: str) -> None:
    words = bridge_words("q1", OPTIONS, PORTS)
    vsctl(database, *words)
    expected = contents(database)
    vsctl(database, *words)
    assert contents(database) == expected


def test_ports_cost_the_same_words_each_and_nothing_is_looked_up() -> None:
    ports = {f"s1-eth{number}": [f"ofport_request={number}"] for number in range(1, 1025)}
    words = bridge_words("s1", OPTIONS, ports)
    assert not LOOKED_UP & set(words)
    assert words.count("create") == 2 * (len(ports) + 1) + 1  # rows of ports, and the bridge
    assert words.count("del-br") == words.count("add") == 1
