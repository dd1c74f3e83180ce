"""A job for which its network cannot have light is refused before anything starts."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import pytest

from qmn.network.description import describe_network
from qmn.network.light_checks import check_light, check_source
from qmn.network.options import NetworkOptions
from qmn.options import BadInput
from topologies.description.description import Description, LaidFiber
from wire.parameters.fiber import optics
from wire.parameters.physics import Device, Emitter, PairSource
from wire.parameters.switch import QuantumSwitch

EMITTING = Device(source=PairSource(statistics="none"), emitter=Emitter(scheme="single-click"))


def parts(
    fibers: Mapping[str, int],
    sources: Sequence[str] = ("c",),
    devices: Mapping[str, Device] | None = None,
    pairs_from: Mapping[str, str] | None = None,
) -> Description:
    """Return hosts a, b and c with a number of fibres to each switch, as {"a q1": 2}."""
    plain, laid = optics("fibre"), []
    for ends, count in fibers.items():
        one, other = ends.split()
        laid += [LaidFiber(one, other, plain)] * count
    nodes = {end for fiber in laid for end in (fiber.a, fiber.b)}
    return Description(
        hosts={host: Device() for host in ("a", "b", "c")} | {**(devices or {})},
        switches={name: QuantumSwitch(name) for name in nodes if name.startswith("q")},
        fibers=tuple(laid),
        sources=tuple(sources),
        pairs_from=pairs_from or {},
    )


WHOLE = {"a q1": 1, "b q1": 2, "c q1": 2}
TWO_SWITCHES = {"a q1": 1, "b q1": 2, "c q2": 2}
AS_ONE_OF_ITS_ENDS = "^{0} needs a third host that makes pairs, and {1} is one of its ends: "


@pytest.mark.parametrize("service", ["sdc", "teleport", "distribute", "bb84", "bbm92", "mdi"])
def test_a_network_with_a_source_and_ways_is_enough(service: str) -> None:
    check_light(service, ("a", "b"), parts(WHOLE))


@pytest.mark.parametrize("service", ["teleport", "distribute", "seal", "bb84", "ghz", "swap"])
def test_who_asks_can_make_the_pairs_of_some_services(service: str) -> None:
    check_light(service, ("a", "b"), parts(WHOLE, sources=["a"]))


@pytest.mark.parametrize(
    ("service", "words"),
    [
        ("sdc", "^sdc needs a third host that makes pairs, and none is one here: give a host sour"),
        ("mdi", "^mdi needs a relay between both ends, and none is one here: give a host source="),
    ],
)
def test_without_a_source_there_is_no_job_that_needs_one(service: str, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        check_light(service, ("a", "b"), parts(WHOLE, sources=()))
    with pytest.raises(BadInput, match=words):
        check_source(service, parts(WHOLE, sources=()))
    check_light("bb84", ("a", "b"), parts(WHOLE, sources=()))
    check_source("bb84", parts(WHOLE, sources=()))


@pytest.mark.parametrize(
    ("service", "source"), [("sdc", "a"), ("sdc", "b"), ("bbm92", "a"), ("teleport", "b")]
)
def test_a_source_that_is_an_end_is_refused(service: str, source: str) -> None:
    with pytest.raises(BadInput, match=AS_ONE_OF_ITS_ENDS.format(service, source)) as refused:
        check_light(service, ("a", "b"), parts(WHOLE, sources=[source]))
    assert "another, --source" not in str(refused.value)
    with pytest.raises(BadInput, match="name another, --source"):
        check_light(service, ("a", "b"), parts(WHOLE), source, named=True)


def test_the_source_is_the_one_that_the_host_names_or_the_last() -> None:
    """As a network is built: topologies/nodes/quantum_host.py."""
    lit = parts(WHOLE, sources=("a", "c"), pairs_from={"b": "a"})
    check_light("sdc", ("a", "b"), lit)
    with pytest.raises(BadInput, match=AS_ONE_OF_ITS_ENDS.format("sdc", "a")):
        check_light("sdc", ("b", "a"), lit)


def test_a_source_out_of_reach_is_refused_with_what_to_join() -> None:
    words = "^sdc needs light between c and a, and no way .*: join q2 and q1, as by addFibers$"
    with pytest.raises(BadInput, match=words):
        check_light("sdc", ("a", "b"), parts(TWO_SWITCHES))
    check_light("sdc", ("a", "b"), parts({**TWO_SWITCHES, "q1 q2": 1}))
    check_light("bb84", ("a", "b"), parts(TWO_SWITCHES))


def test_hosts_pass_no_light_on() -> None:
    by_c = {"a q1": 2, "c q1": 1, "c q2": 1, "b q2": 2}
    check_light("ghz", ("a", "c", "b"), parts(by_c))
    for service in ("ghz", "bb84"):
        with pytest.raises(BadInput, match=f"^{service} needs light between a and b"):
            check_light(service, ("a", "b"), parts(by_c))


@pytest.mark.parametrize(
    ("fibers", "words"),
    [
        ({"b q1": 1}, "^b has 1 fibre, and sdc needs 2 there: lay more "),
        ({"c q1": 1}, "^c has 1 fibre, and sdc needs 2 there: lay more "),
        ({"a q1": 0}, "^a has 0 fibres, and sdc needs 1 there: lay more "),
    ],
)
def test_a_host_with_too_few_fibres_is_named(fibers: Mapping[str, int], words: str) -> None:
    with pytest.raises(BadInput, match=words):
        check_light("sdc", ("a", "b"), parts({**WHOLE, **fibers}))


def test_a_station_heralds_pairs_of_memories_that_emit() -> None:
    network = parts(WHOLE, devices={"a": EMITTING, "b": EMITTING})
    with pytest.raises(BadInput, match=r"^distribute: a has .* emits, and no .* has a station"):
        check_light("distribute", ("a", "b"), network)
    stations = {name: replace(each, analysers=1) for name, each in network.switches.items()}
    check_light("distribute", ("a", "b"), replace(network, switches=stations))


def test_the_last_of_several_sources_makes_pairs_in_a_described_network() -> None:
    options = NetworkOptions(topology="sdc")
    assert describe_network(options).parts.source_for("alice") == "charlie"
