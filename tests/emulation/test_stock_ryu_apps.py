"""Ryu's own apps, unchanged, on our quantum switch: gui_topology, and the apps that it needs.

And our REST, which shares their HTTP server.
"""

import json
import re
import urllib.error
import urllib.request
from collections.abc import Iterator
from typing import Any

import pytest
from conftest import nothing_left, wait_until
from fabric_scene import running, session
from limits import SOON_S

from topologies.networks.network import Network
from topologies.sdc import SdcTopo
from topologies.system.runs.runtime import free_port

# It needs ofctl_rest, ws_topology and rest_topology, which needs topology.switches.
APPS = ["ryu.app.gui_topology.gui_topology"]
Q1 = 0x1001


class Http:
    """The controller's HTTP server."""

    def __init__(self, address: str, token: str) -> None:
        self.address = address
        self.headers = {"Authorization": f"Bearer {token}", "Content-Type": "application/json"}

    def get(self, path: str) -> Any:
        request = urllib.request.Request(f"http://{self.address}{path}", headers=self.headers)
        with urllib.request.urlopen(request, timeout=SOON_S) as answer:  # noqa: S310
            return json.load(answer)

    def post(self, path: str, content: Any) -> tuple[int, bytes]:
        """Return status and body."""
        data = content if isinstance(content, bytes) else json.dumps(content).encode()
        request = urllib.request.Request(f"http://{self.address}{path}", data, self.headers)
        try:
            with urllib.request.urlopen(request, timeout=SOON_S) as answer:  # noqa: S310
                return answer.status, answer.read()
        except urllib.error.HTTPError as error:
            with error:
                return error.code, error.read()


@pytest.fixture(scope="module")
def network(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Network]:
    """Start one whose controller also runs the stock apps."""
    address, folder = f"127.0.0.1:{free_port()}", tmp_path_factory.mktemp("run")
    with nothing_left(), running(SdcTopo, folder, rest=address, apps=APPS) as network:
        yield network


@pytest.fixture
def http(network: Network) -> Http:
    """The HTTP server of its controller."""
    return Http(network.runtime.settings.rest, network.runtime.rest_token())


def test_stock_apps_read_and_program_the_switch(http: Http, network: Network) -> None:
    assert sorted(http.get("/stats/switches")) == [1, Q1]
    counters = http.get(f"/stats/port/{Q1}")[str(Q1)]
    described = http.get(f"/stats/portdesc/{Q1}")[str(Q1)]
    fibers = {port["name"]: port["port_no"] for port in described}
    assert {f"q1-eth{number}" for number in range(1, 7)} <= set(fibers)
    assert {port["port_no"] for port in counters} >= set(fibers.values()) - {"LOCAL"}

    one, other = fibers["q1-eth2"], fibers["q1-eth3"]
    entry = {
        "dpid": Q1,
        "priority": 500,
        "cookie": 0xBEEF,
        "match": {"in_port": one},
        # With OpenFlow 1.4 ofctl_rest overlooks bare "actions".
        "instructions": [{"type": "APPLY_ACTIONS", "actions": [{"type": "OUTPUT", "port": other}]}],
    }
    assert http.post("/stats/flowentry/add", entry)[0] == 200
    events = network.runtime.logs / "quantum.log"
    wait_until(
        lambda: re.search(rf"q1 +open .*{one} -> {other}", events.read_text()),
        "the cross-connect is made",
    )
    (shown,) = [flow for flow in http.get(f"/stats/flow/{Q1}")[str(Q1)] if flow["priority"] == 500]
    assert shown["match"] == {"in_port": one}
    assert [rule["actions"][0]["port"] for rule in shown["instructions"]] == [other]
    assert (shown["cookie"], shown["packet_count"]) == (0xBEEF, 0)
    assert http.post("/stats/flowentry/delete_strict", entry)[0] == 200
    wait_until(
        lambda: re.search(rf"q1 +close .*{one}", events.read_text()), "the cross-connect is undone"
    )
    assert not [flow for flow in http.get(f"/stats/flow/{Q1}")[str(Q1)] if flow["priority"] == 500]


def test_light_paths_are_connectivity_services_while_they_stand(
    http: Http, network: Network
) -> None:
    context = "/restconf/data/tapi-common:context"
    services = f"{context}/tapi-connectivity:connectivity-context/connectivity-service"
    name = "tapi-connectivity:connectivity-service"
    assert http.get(services) == {name: []}
    with session(network, "alice", "bob") as opened:
        assert opened.carry(b"x") == b"x"
        report = http.get(services)[name]
        ends = {tuple(end["local-id"] for end in each["end-point"]) for each in report}
        assert ("charlie-q0", "alice-q0") in ends
        assert {each["lifecycle-state"] for each in report} == {"INSTALLED"}
        one = f"{services}={report[0]['uuid']}"
        assert http.get(one) == {name: [report[0]]}
    wait_until(lambda: http.get(services) == {name: []}, "the paths are closed")
    with pytest.raises(urllib.error.HTTPError, match="404") as caught:
        http.get(one)
    with caught.value as error:
        assert "ietf-restconf:errors" in json.load(error)


def test_stock_apps_read_what_the_switch_is(http: Http) -> None:
    assert http.get(f"/stats/desc/{Q1}")[str(Q1)]["mfr_desc"] == "qmn"
    (table,) = http.get(f"/stats/tablefeatures/{Q1}")[str(Q1)]
    assert (table["table_id"], table["name"]) == (0, "light")


def optical(port: dict[str, Any]) -> dict[str, Any] | None:
    """Return the optical property of a port, None if it has none."""
    found = [one for one in port["properties"] if one["type"] == "OPTICAL"]
    return found[0] if found else None


def test_stock_apps_read_and_tune_the_light(http: Http) -> None:
    described = {port["name"]: port for port in http.get(f"/stats/portdesc/{Q1}")[str(Q1)]}
    fibers = {f"q1-eth{number}" for number in range(2, 7)}
    assert {name for name, port in described.items() if optical(port)} == fibers
    range_ = optical(described["q1-eth2"])
    assert range_ is not None
    assert (range_["tx_min_freq_lmda"], range_["tx_max_freq_lmda"]) == (191_350_000, 196_100_000)
    port = described["q1-eth2"]

    def frequency() -> int:
        (counters,) = http.get(f"/stats/port/{Q1}/{port['port_no']}")[str(Q1)]
        light = optical(counters)
        assert light is not None
        return int(light["tx_freq_lmda"])

    tuning = {
        "type": "OPTICAL",
        "configure": 0b1010,  # OFPOPF_TX_TUNE, OFPOPF_USE_FREQ
        "freq_lmda": 193_500_000,
        "fl_offset": 0,
        "grid_span": 50_000,
        "tx_pwr": 0,
    }
    order = {"dpid": Q1, "port_no": port["port_no"], "hw_addr": port["hw_addr"]}
    assert frequency() == 193_400_000
    assert http.post("/stats/portdesc/modify", {**order, "properties": [tuning]})[0] == 200
    wait_until(lambda: frequency() == 193_500_000, "the port is tuned")


def test_the_topology_app_sees_the_switch(http: Http) -> None:
    switches = {int(switch["dpid"], 16): switch for switch in http.get("/v1.0/topology/switches")}
    assert set(switches) == {1, Q1}
    assert len(switches[Q1]["ports"]) == 6
    wait_until(
        lambda: (
            {
                (int(link["src"]["dpid"], 16), int(link["dst"]["dpid"], 16))
                for link in http.get("/v1.0/topology/links")
            }
            == {(1, Q1), (Q1, 1)}
        ),
        "the copper between s1 and q1 is found from both sides",
    )


def test_our_facts_are_there_for_scripts(http: Http) -> None:
    wait_until(
        lambda: all(device["state"] == "up" for device in http.get("/qmn/devices")), "all heard"
    )
    assert http.get("/qmn/sessions") == http.get("/qmn/paths")["paths"] == []
    assert len(http.get("/qmn/paths")["fibers"]) == 5
    status, body = http.post("/qmn/devices/alice", {"rate_hz": 1000000, "frame_bytes": 64})
    assert (status, json.loads(body)["overrides"]) == (
        200,
        {"rate_hz": 1_000_000, "frame_bytes": 64},
    )
    for device, content, words in (
        ("eve", {"rate_hz": 1}, "no device 'eve'"),
        ("alice", {"rate_hz": 0}, "rate_hz 0: choose 1 to"),
        ("alice", {"rate_hz": "1"}, "give a whole number"),
        ("alice", {"speed": 1}, "no setting 'speed'"),
        ("alice", [], "settings are an object"),
        ("alice", b"{", "the body is not JSON"),
    ):
        status, body = http.post(f"/qmn/devices/{device}", content)
        assert status == 400
        assert words in json.loads(body)["error"]
    assert http.post("/qmn/devices/alice", b" " * 5000)[0] == 413
