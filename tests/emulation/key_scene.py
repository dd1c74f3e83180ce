"""A network whose hosts keep keys: alice with charlie, and charlie with bob."""

import json
from typing import Any

from applications.keys.config import KeyLink, manager_name
from applications.keys.key_managers import KeyService, start_key_managers
from topologies.networks.network import Network
from topologies.system.processes.programs import Program

LOW, HIGH = 8, 16
LINK = KeyLink("", True, low=LOW, high=HIGH, options={"count": 12_000})
CURL = "curl -sS --cert $SAE_CERT --key $SAE_KEY --cacert $KME_CA"


def keep_keys(network: Network) -> None:
    """Capture alice's cable and others, and start the key managers; charlie has two SAEs."""
    network.capture("s1")
    pairs, saes = (("alice", "charlie"), ("charlie", "bob")), {"sae-web": "charlie"}
    start_key_managers(network, KeyService(pairs, LINK, saes, keys_per_s=1000.0))


class Keys:
    """Requests of the applications on its hosts."""

    def __init__(self, network: Network) -> None:
        self.network = network

    def manager(self, host: str) -> Program:
        """Return the key manager of a host."""
        name, programs = manager_name(host), self.network.runtime.programs
        return next(each for each in programs if each.name == name)

    def run(self, host: str, command: str) -> str:
        return str(self.network.host(host).cmd(command)).replace("\r", "")

    def curl(self, host: str, path: str, words: str = "") -> tuple[int, Any]:
        """Return status and body of a request of the host's own application."""
        text = self.run(host, f'{CURL} {words} -w "\\n%{{http_code}}" "$KME/api/v1/keys/{path}"')
        body, _, status = text.strip().rpartition("\n")
        return int(status), json.loads(body) if body else None

    def stored(self, other: str = "charlie") -> int:
        """Return how many keys alice can have with a host."""
        _status, reply = self.curl("alice", f"sae-{other}/status")
        return int(reply["stored_key_count"])
