"""A network's quantum switch, asked over gNMI, by TLS, by pygnmi."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from fabric_scene import running, session
from limits import SOON_S

from topologies.networks.network import Network
from topologies.sdc import SdcTopo

ASK = """
import json, sys
from pygnmi.client import gNMIclient

host, port = sys.argv[1].split(":")
names = {"path_root": "ca.pem", "path_cert": "operator.pem", "path_key": "operator.key"}
files = {name: f"{sys.argv[3]}/{file}" for name, file in names.items()}
with gNMIclient(target=(host, int(port)), **files) as client:
    print(json.dumps(client.get(path=[sys.argv[2]], encoding="json")))
"""


def asked(network: Network, path: str) -> dict[str, Any]:
    """Return what q1 tells at a path, by path."""
    address = network.runtime.gnmi_addresses["q1"]
    done = subprocess.run(
        [sys.executable, "-c", ASK, address, path, str(network.runtime.folder / "tls")],
        capture_output=True,
        text=True,
        check=True,
        timeout=SOON_S,
    )
    report = json.loads(done.stdout)["notification"]
    return {each["path"]: each["val"] for part in report for each in part.get("update", ())}


def test_operators_see_photons_power_and_paths_of_a_session(tmp_path: Path) -> None:
    with running(SdcTopo, tmp_path, gnmi=True, tls=True) as network:
        port = f"q1-eth{port_of(network, 'bob')}"
        counter = f"interfaces/interface[name={port}]/state/counters/out-pkts"
        assert asked(network, f"/{counter}") == {counter: 0}
        with session(network, "alice", "bob") as opened:
            data = bytes(100)
            assert opened.carry(data) == data
            photons = asked(network, f"/{counter}")[counter]
            assert photons >= 4 * len(data)  # two bits a pair, and one of its halves here
            channels = asked(network, "/wavelength-router")
            passed = [value for path, value in channels.items() if path.endswith("photons")]
            assert photons in passed
            ends = {value for path, value in channels.items() if path.endswith("port-name")}
            assert port in ends
        assert set(asked(network, "/.../input-power/instant").values()) == {0.0}


def port_of(network: Network, host: str) -> int:
    """Return the port of q1 at which a host's first fibre is."""
    ends = [(fiber.a, fiber.b) for fiber in network.runtime.fibers]
    found = sorted((a.port, b.port) for a, b in ends if a.node == host)
    return int(found[0][1])
