"""Keys relayed by a trusted host over a real network, by whom the controller and its policy say."""

import base64
import json
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from conftest import nothing_left, verb, wait_until
from fabric_scene import facts, running
from scapy.utils import rdpcap

from applications.keys.key_managers import KeyService, start_key_managers
from topologies.networks.network import Network
from topologies.sdc import SdcTopo
from topologies.system.runs.runtime import free_port
from wire.key_manager import KeyLink

LINK = KeyLink("", True, low=8, high=16, options={"count": 12_000})
PAIRS = ("alice", "charlie"), ("charlie", "bob")
TRUSTED = '[[trusted]]\nhost = "charlie"\n'
CURL = 'curl -sS --cert $SAE_CERT --key $SAE_KEY --cacert $KME_CA -w "\\n%{http_code}"'


class Scene:
    """alice and bob, who have no key link with each other, and charlie, who has one with each."""

    def __init__(self, network: Network, policy: Path) -> None:
        self.network, self.policy = network, policy

    def curl(self, host: str, path: str) -> tuple[int, Any]:
        """Return status and body of a request of a host's application."""
        said = self.network.host(host).cmd(f'{CURL} "$KME/api/v1/keys/{path}"')
        body, _, status = str(said).replace("\r", "").strip().rpartition("\n")
        return int(status), json.loads(body) if body else None

    def qmn(self, *words: str) -> str:
        """Return what a verb says about this network."""
        return verb(*words).stdout

    def ready(self) -> int:
        """Return how many keys alice can have with bob."""
        _status, said = self.curl("alice", "sae-bob/status")
        return int(said["stored_key_count"])


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Scene]:
    """Run the network of the module until charlie can relay."""
    folder = tmp_path_factory.mktemp("run")
    policy = folder / "policy.toml"
    policy.write_text(TRUSTED)
    settings: dict[str, Any] = {"policy": str(policy), "contention": "queue"}
    settings["rest"] = f"127.0.0.1:{free_port()}"
    with nothing_left(), running(SdcTopo, folder, **settings) as network:
        network.capture("s1")
        start_key_managers(network, KeyService(PAIRS, LINK))
        made = Scene(network, policy)
        wait_until(lambda: made.ready() >= 4, "keys of both links")
        yield made


def test_alice_and_bob_get_the_same_key_by_way_of_charlie(scene: Scene) -> None:
    status, got = scene.curl("alice", "sae-bob/enc_keys?number=2&size=264")
    assert status == 200, got
    for key in got["keys"]:
        assert len(base64.b64decode(key["key"], validate=True)) == 33
        said = scene.curl("bob", f"sae-alice/dec_keys?key_ID={key['key_ID']}")
        assert said == (200, {"keys": [key]})
    (chosen,) = [each for each in facts(scene.network, "key-route") if each["stored"] == 4]
    assert chosen["route"] == ["alice", "charlie", "bob"]
    packets = rdpcap(str(scene.network.runtime.logs / "s1-eth1.pcap"))
    captured = b"".join(bytes(packet) for packet in packets)
    assert len(captured) > 10_000
    for key in got["keys"]:
        assert base64.b64decode(key["key"]) not in captured
        assert key["key_ID"].encode() not in captured  # under TLS


def told(scene: Scene) -> dict[str, Any]:
    """Return what the controller tells of each node."""
    nodes = json.loads(scene.qmn("keys", "--json"))["qkd_nodes"]
    return {each["qkdn_location_id"]: each for each in nodes}


def rates(nodes: dict[str, Any]) -> list[float]:
    """Return the secret key rates of both links of charlie's."""
    links = nodes["charlie"]["qkd_links"]["qkd_link"][:2]
    return [each["qkdl_performance"]["skr"] for each in links]


def test_the_controller_tells_of_links_and_applications(scene: Scene) -> None:
    scene.curl("alice", "sae-bob/enc_keys")
    # Key managers tell the controller now and then.
    wait_until(lambda: all(rate > 0 for rate in rates(told(scene))), "rates of both links")
    nodes = told(scene)
    links = nodes["charlie"]["qkd_links"]["qkd_link"]
    assert [(each["qmn"]["to"], each["qkdl_type"]) for each in links] == [
        ("bob", "PHYS"),
        ("alice", "PHYS"),
        ("bob", "VIRT"),
    ]
    for link in links[:2]:
        assert link["qkdl_status"] == "ACTIVE"
        (qber,) = link["qkdl_performance"]["phys_perf"]
        assert (qber["perf_type"], qber["value"]) == ("QBER", 0.0)  # fibres without noise
    virtual = links[2]
    assert virtual["virt_prev_hop"] == nodes["alice"]["qkdn_id"]
    assert virtual["virt_next_hop"] == [nodes["bob"]["qkdn_id"]]
    (application,) = nodes["alice"]["qkd_applications"]["qkd_app"]
    assert (application["server_app_id"], application["client_app_id"]) == (
        "sae-alice",
        ["sae-bob"],
    )
    assert application["backing_qkdl_id"] == [virtual["qkdl_id"]]
    assert application["app_id"] in virtual["qkdl_applications"]
    assert "sae-alice" in scene.qmn("keys")


def test_it_tells_them_over_http_to_who_has_the_token(scene: Scene) -> None:
    """Nodes, links and applications as `qmn keys --json` has them; counts and times go on."""
    scene.curl("alice", "sae-bob/enc_keys")
    runtime = scene.network.runtime
    url = f"http://{runtime.settings.rest}/qmn/keys"
    with pytest.raises(urllib.error.HTTPError) as refused:
        urllib.request.urlopen(url, timeout=10)
    with refused.value as error:
        assert error.code == 401
    asking = urllib.request.Request(
        url, headers={"Authorization": f"Bearer {runtime.rest_token()}"}
    )
    with urllib.request.urlopen(asking, timeout=10) as answer:  # noqa: S310
        assert answer.headers["Content-Type"] == "application/json"
        over_http = json.load(answer)
    assert names(over_http) == names(json.loads(scene.qmn("keys", "--json")))


def names(told: Any) -> dict[str, tuple[list[str], list[str]]]:
    """Return which links and applications each node has, by its name."""
    return {
        node["qkdn_location_id"]: (
            [link["qkdl_id"] for link in node["qkd_links"]["qkd_link"]],
            [each["app_id"] for each in node["qkd_applications"]["qkd_app"]],
        )
        for node in told["qkd_nodes"]
    }


def test_a_policy_that_trusts_nobody_ends_the_relay(scene: Scene) -> None:
    scene.policy.write_text("")
    scene.qmn("set", "policy", "reload")
    status, said = scene.curl("alice", "sae-bob/enc_keys")
    assert status == 503
    assert "no host that the policy trusts joins alice and bob: charlie could" in said["message"]
    assert scene.ready() == 0
    scene.policy.write_text(TRUSTED + 'between = ["bob", "alice"]\n')
    scene.qmn("set", "policy", "reload")
    assert scene.curl("alice", "sae-bob/enc_keys")[0] == 200
