"""Keys relayed by a trusted host over a real network, by whom the controller and its policy say."""

import base64
import json
import urllib.error
import urllib.request
from collections.abc import Iterator
from typing import Any

import pytest
from conftest import policy, policy_of, verb, wait_until
from fabric_scene import facts
from key_scene import Keys
from scapy.utils import rdpcap

from topologies.networks.network import Network

TRUSTED = '[[trusted]]\nhost = "charlie"\n'


@pytest.fixture
def keys(keys_network: Network) -> Iterator[Keys]:
    """Give alice and bob, who have no key link with each other, once charlie can relay."""
    found = Keys(keys_network)
    with policy(keys_network, TRUSTED):
        wait_until(lambda: found.stored("bob") >= 4, "keys of both links")
        yield found


def test_alice_and_bob_get_the_same_key_by_way_of_charlie(keys: Keys) -> None:
    status, got = keys.curl("alice", "sae-bob/enc_keys?number=2&size=264")
    assert status == 200, got
    for key in got["keys"]:
        assert len(base64.b64decode(key["key"], validate=True)) == 33
        text = keys.curl("bob", f"sae-alice/dec_keys?key_ID={key['key_ID']}")
        assert text == (200, {"keys": [key]})
    (chosen,) = [each for each in facts(keys.network, "key-route") if each["stored"] == 4]
    assert chosen["route"] == ["alice", "charlie", "bob"]
    packets = rdpcap(str(keys.network.runtime.logs / "s1-eth1.pcap"))
    captured = b"".join(bytes(packet) for packet in packets)
    assert len(captured) > 10_000
    for key in got["keys"]:
        assert base64.b64decode(key["key"]) not in captured
        assert key["key_ID"].encode() not in captured  # under TLS


def status(keys: Keys) -> dict[str, Any]:
    """Return what the controller tells of each node."""
    nodes = json.loads(verb("keys", "--json").stdout)["qkd_nodes"]
    return {each["qkdn_location_id"]: each for each in nodes}


def rates(nodes: dict[str, Any]) -> list[float]:
    """Return the secret key rates of both links of charlie's."""
    links = nodes["charlie"]["qkd_links"]["qkd_link"][:2]
    return [each["qkdl_performance"]["skr"] for each in links]


def test_the_controller_tells_of_links_and_applications(keys: Keys) -> None:
    keys.curl("alice", "sae-bob/enc_keys")
    # Key managers tell the controller now and then.
    wait_until(lambda: all(rate > 0 for rate in rates(status(keys))), "rates of both links")
    nodes = status(keys)
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
    applications = nodes["alice"]["qkd_applications"]["qkd_app"]
    (application,) = (each for each in applications if each["client_app_id"] == ["sae-bob"])
    assert application["server_app_id"] == "sae-alice"
    assert application["backing_qkdl_id"] == [virtual["qkdl_id"]]
    assert application["app_id"] in virtual["qkdl_applications"]
    assert "sae-alice" in verb("keys").stdout


def test_it_tells_them_over_http_to_who_has_the_token(keys: Keys) -> None:
    """Nodes, links and applications as `qmn keys --json` has them; counts and times go on."""
    keys.curl("alice", "sae-bob/enc_keys")
    runtime = keys.network.runtime
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
    assert names(over_http) == names(json.loads(verb("keys", "--json").stdout))


def names(report: Any) -> dict[str, tuple[list[str], list[str]]]:
    """Return which links and applications each node has, by its name."""
    return {
        node["qkdn_location_id"]: (
            [link["qkdl_id"] for link in node["qkd_links"]["qkd_link"]],
            [each["app_id"] for each in node["qkd_applications"]["qkd_app"]],
        )
        for node in report["qkd_nodes"]
    }


def test_a_policy_that_trusts_nobody_ends_the_relay(keys: Keys) -> None:
    policy_of(keys.network).write_text("")
    verb("set", "policy", "reload")
    status, text = keys.curl("alice", "sae-bob/enc_keys")
    assert status == 503
    assert "no host that the policy trusts joins alice and bob: charlie could" in text["message"]
    assert keys.stored("bob") == 0
    policy_of(keys.network).write_text(TRUSTED + 'between = ["bob", "alice"]\n')
    verb("set", "policy", "reload")
    assert keys.curl("alice", "sae-bob/enc_keys")[0] == 200
