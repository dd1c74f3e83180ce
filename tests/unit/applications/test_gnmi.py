"""OpenConfig over gNMI, asked by pygnmi, a client that is not ours."""

import asyncio
import re
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import grpc
import pytest
from limits import SOON_S
from pygnmi.client import gNMIclient, gNMIException
from pygnmi.create_gnmi_path import gnmi_path_generator
from pygnmi.spec.v080 import gnmi_pb2 as gnmi
from pygnmi.spec.v080.gnmi_pb2_grpc import add_gNMIServicer_to_server, gNMIStub
from stepping import SINCE_NS, stepping

import applications.telemetry
from applications.telemetry.open_config import Fiber, Leaf, Observed, found, leaves
from applications.telemetry.service import (
    MAX_PATHS,
    MAX_STREAMS,
    Telemetry,
    Unusable,
    path_of,
    require_encoding,
)
from qswitch_agent.hardware.optics import (
    CircuitReading,
    CrossConnect,
    HardwareFault,
    PortReading,
    Quantity,
    Readings,
)
from topologies.system.runs.runtime import free_port
from wire.network_time import NetworkTime
from wire.optical import ALL_VALID, ANY_PORT, VALID_RX_PWR, PathOptics, PortLight

LIGHT = PortLight(ALL_VALID, 193_100_000, 0, 12_500, 193_100_000, 0, 12_500, 15, -73, 305, 255)
DARK = PortLight(ALL_VALID & ~VALID_RX_PWR, 0, 0, 0, 0, 0, 0, 15, -32768, 305, 255)
POWER = "/components/component[name=q1-eth1]/port/optical-port/state/input-power/instant"
BIAS = (
    "/components/component[name=q1-eth1]/transceiver/physical-channels/channel[index=0]"
    "/state/laser-bias-current/instant"
)
PHOTONS = "/interfaces/interface[name=q1-eth1]/state/counters/in-pkts"
DISCARDS = "/interfaces/interface[name=q1-eth1]/state/counters/in-discards"
HEAT = "/components/component[name=q1]/state/temperature/instant"
CHANNEL = "/wavelength-router/media-channels/channel[index=77]"


def seen(photons: int = 1_000_000, standing: bool = True, **readings: Any) -> list[Leaf]:
    """Return the report on a switch with two fibres, the second of which is cut."""
    ports = {1: PortReading(photons_in=photons, photons_out=5, photons_lost=3)}
    circuits = {77: CircuitReading(photons - 3, 0, 0)}
    return leaves(
        Observed(
            "q1",
            {1: Fiber("q1-eth1", True, LIGHT), 2: Fiber("q1-eth2", False, DARK)},
            Readings(ports, circuits, 25.5, **readings),
            [CrossConnect(1, 2, 77)] if standing else [],
            [PathOptics(ANY_PORT, ANY_PORT, 900, 0), PathOptics(1, 2, 1250, 0)],
        )
    )


class Served:
    """A service at a port, on an event loop of its own, and a client's calls."""

    def __init__(self) -> None:
        self.seen, self.time = seen(), NetworkTime()
        self.fault: Exception | None = None
        self.port = free_port()

    async def observe(self) -> list[Leaf]:
        if self.fault is not None:
            raise self.fault
        return self.seen

    def client(self) -> Any:
        return gNMIclient(target=("127.0.0.1", self.port), insecure=True)


@pytest.fixture
def served() -> Iterator[Served]:
    with serving(Served()) as scene:
        yield scene


@contextmanager
def serving(scene: Served) -> Iterator[Served]:
    ready, loop = threading.Event(), asyncio.new_event_loop()
    ended = asyncio.Event()

    async def run() -> None:
        server = grpc.aio.server()
        add_gNMIServicer_to_server(Telemetry(scene.observe, scene.time), server)
        server.add_insecure_port(f"127.0.0.1:{scene.port}")
        await server.start()
        ready.set()
        await ended.wait()
        await server.stop(0)

    thread = threading.Thread(target=loop.run_until_complete, args=(run(),))
    thread.start()
    assert ready.wait(SOON_S)
    try:
        yield scene
    finally:
        loop.call_soon_threadsafe(ended.set)
        thread.join(SOON_S)
        assert not thread.is_alive()
        loop.close()


def values(answer: Any) -> dict[str, Any]:
    """Return what a client has read, by path; its paths have no first slash."""
    return {
        f"/{update['path']}": update["val"]
        for notification in answer["notification"]
        for update in notification.get("update", ())
    }


def test_a_stock_client_reads_power_loss_photons_and_temperature(served: Served) -> None:
    with served.client() as client:
        reports = values(client.get(path=["/"], encoding="json"))
    assert reports[POWER] == -7.3
    assert reports[BIAS] == 30.5
    assert (reports[PHOTONS], reports[DISCARDS], reports[HEAT]) == (1_000_000, 3, 25.5)
    assert reports[f"{CHANNEL}/state/qmn-light:insertion-loss"] == 1.25
    assert reports[f"{CHANNEL}/state/qmn-light:photons"] == 999_997
    assert reports[f"{CHANNEL}/source/state/port-name"] == "q1-eth1"
    assert reports[f"{CHANNEL}/dest/state/port-name"] == "q1-eth2"
    assert reports["/interfaces/interface[name=q1-eth2]/state/oper-status"] == "DOWN"
    # From a cut fibre no light comes: no value rather than a wrong one.
    assert POWER.replace("eth1", "eth2") not in reports


def test_what_is_read_in_stepped_time_is_of_its_instant() -> None:
    scene = Served()
    with stepping() as gate:
        scene.time = gate.time
        with serving(scene), scene.client() as client:
            (read,) = client.get(path=["/"], encoding="json")["notification"]
    assert read["timestamp"] == SINCE_NS


def test_json_of_the_ietf_writes_large_numbers_and_fractions_as_strings(served: Served) -> None:
    with served.client() as client:
        reports = values(client.get(path=[PHOTONS, POWER], encoding="json_ietf"))
        assert reports == {PHOTONS: "1000000", POWER: "-7.300"}  # RFC 7951, 6.1
        index = f"{CHANNEL}/state/index"
        assert values(client.get(path=[index], encoding="json_ietf")) == {index: 77}
        assert values(client.get(path=[PHOTONS], encoding="proto")) == {PHOTONS: 1_000_000}


@pytest.mark.parametrize(
    ("path", "count"),
    [
        ("/interfaces/interface/state/counters", 6),
        ("/interfaces/interface[name=*]/state/counters/in-pkts", 2),
        ("/interfaces/interface[name=q1-eth2]", 5),
        ("/components/*/state/name", 3),
        ("/.../instant", 6),
        ("openconfig-platform:components/component[name=q1]/state/temperature", 1),
        (CHANNEL, 7),
    ],
)
def test_paths_find_what_their_wildcards_say(path: str, count: int) -> None:
    asked = path_of(gnmi.Path(), gnmi_path_generator(path))
    assert len(found(seen(), asked)) == count


def test_what_is_not_measured_is_absent() -> None:
    reports = {leaf.path[-1].name for leaf in seen(not_measured=frozenset({Quantity.PHOTONS}))}
    assert not reports & {"in-pkts", "out-pkts", "in-discards", "qmn-light:photons"}
    assert "instant" in reports


def test_what_cannot_be_answered_is_refused_by_its_name(served: Served) -> None:
    def refused(act: Callable[[], Any]) -> str:
        with pytest.raises(gNMIException) as caught:
            act()
        return str(caught.value)

    with served.client() as client:
        assert "nothing at nowhere" in refused(lambda: client.get(path=["/nowhere"]))
        many = [POWER] * (MAX_PATHS + 1)
        assert f"at most {MAX_PATHS}" in refused(lambda: client.get(path=many))
        assert "by OpenFlow" in refused(lambda: client.set(update=[(POWER, {"a": 1})]))
        served.fault = HardwareFault("no answer")
        assert "no answer" in refused(lambda: client.get(path=[POWER]))
    with pytest.raises(Unusable, match="encoding 3: choose one of JSON, JSON_IETF, PROTO"):
        require_encoding(gnmi.ASCII)
    with pytest.raises(Unusable, match="33 elements"):
        path_of(gnmi.Path(), gnmi_path_generator("/a" * 33))


def test_capabilities_name_models_and_encodings(served: Served) -> None:
    with served.client() as client:
        report = client.capabilities()
    assert {"json", "json_ietf", "proto"} == set(report["supported_encodings"])
    models = {model["name"]: model for model in report["supported_models"]}
    assert "openconfig-platform" in models
    assert all(model["organization"] and model["version"] for model in models.values())
    module = (Path(applications.telemetry.__file__).parent / "qmn-light.yang").read_text()
    own = models["qmn-light"]
    assert f'organization "{own["organization"]}";' in module
    assert re.findall(r"revision ([0-9-]+) ", module)[0] == own["version"]  # the newest is first
    assert report["gnmi_version"] == "0.8.0"


CHANGES = {"mode": "on_change"}
SAMPLES = {"mode": "sample", "sample_interval": 100_000_000}
TOO_FREQUENT = {"mode": "sample", "sample_interval": 1_000_000}


@contextmanager
def subscribed(client: Any, kind: str, *paths: str, **more: Any) -> Iterator[Any]:
    """Yield the responses of a subscription; it is cancelled after this, or at the deadline."""
    asked = [{"path": path, **more} for path in paths]
    responses = client.subscribe(
        subscribe={"subscription": asked, "mode": kind, "encoding": "json"}
    )
    deadline = threading.Timer(SOON_S, responses.cancel)
    deadline.start()
    try:
        yield responses
    finally:
        deadline.cancel()
        responses.cancel()


def test_a_subscription_once_tells_everything_and_ends(served: Served) -> None:
    with served.client() as client, subscribed(client, "once", PHOTONS) as responses:
        reports = list(responses)
    assert [each.WhichOneof("response") for each in reports] == ["update", "sync_response"]
    assert reports[0].update.update[0].val.json_val == b"1000000"


def test_a_stream_tells_changes_and_what_is_gone(served: Served) -> None:
    counters = PHOTONS.rpartition("/")[0]  # of which lost ones and those that leave stay
    asked = "stream", counters, CHANNEL
    with served.client() as client, subscribed(client, *asked, **CHANGES) as reports:
        first = [next(reports) for _ in range(3)]
        assert [each.WhichOneof("response") for each in first][-1] == "sync_response"
        served.seen = seen(2_000_000, standing=False)
        changed, gone = next(reports).update, next(reports).update
        assert [each.val.json_val for each in changed.update] == [b"2000000"]
        assert list(gone.update) == []
        assert len(gone.delete) == 7


def test_a_stream_of_samples_tells_what_has_not_changed_too(served: Served) -> None:
    with served.client() as client, subscribed(client, "stream", PHOTONS, **SAMPLES) as reports:
        kinds = [next(reports).WhichOneof("response") for _ in range(4)]
    assert kinds == ["update", "sync_response", "update", "update"]


def test_samples_that_are_too_frequent_are_refused(served: Served) -> None:
    with (
        served.client() as client,
        subscribed(client, "stream", PHOTONS, **TOO_FREQUENT) as reports,
    ):
        text = refusal(reports)
    assert "sample_interval 0.001 s: at least 0.1 s" in text


def test_a_subscription_by_polls_tells_all_at_each_and_takes_nothing_else(served: Served) -> None:
    asked = gnmi.SubscriptionList(
        subscription=[gnmi.Subscription(path=gnmi_path_generator(PHOTONS))],
        mode=gnmi.SubscriptionList.POLL,
        encoding=gnmi.JSON,
    )
    first, poll = gnmi.SubscribeRequest(subscribe=asked), gnmi.SubscribeRequest(poll=gnmi.Poll())
    with grpc.insecure_channel(f"127.0.0.1:{served.port}") as channel:
        report = gNMIStub(channel).Subscribe(iter([first, poll, poll, first]), timeout=SOON_S)
        kinds = [next(report).WhichOneof("response") for _ in range(4)]
        assert "a subscription by polls has polls alone" in refusal(report)
    assert kinds == 2 * ["update", "sync_response"]


def refusal(responses: Any) -> str:
    """Return why there is no response."""
    with pytest.raises(grpc.RpcError) as caught:
        next(responses)
    return str(caught.value)


def test_no_more_streams_than_there_may_be_are_open_at_a_time(served: Served) -> None:
    with served.client() as client, ExitStack() as opened:
        for _ in range(MAX_STREAMS):
            next(opened.enter_context(subscribed(client, "stream", PHOTONS, **CHANGES)))
        with subscribed(client, "once", PHOTONS) as reports:
            assert f"{MAX_STREAMS} subscriptions are open" in refusal(reports)


@pytest.mark.parametrize("end", ["done", "refused", "failed", "cancelled"])
def test_33_subscriptions_one_after_the_other_are_served(served: Served, end: str) -> None:
    """However each of them ends."""
    served.fault = HardwareFault("no answer") if end == "failed" else None
    kind = "once" if end == "done" else "stream"
    more: dict[str, Any] = TOO_FREQUENT if end == "refused" else CHANGES
    with served.client() as client:
        for _ in range(MAX_STREAMS + 1):
            with subscribed(client, kind, PHOTONS, **more) as reports:
                if end in ("refused", "failed"):
                    assert "open" not in refusal(reports)
                else:
                    assert next(reports).update.update
