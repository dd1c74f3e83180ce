"""The controller uses hosts by what they have announced that they can do."""

from collections.abc import Sequence
from dataclasses import replace

import pytest
from metadata_scene import ALICE, BOB, CHARLIE, FIBERS, FRAMED, Q1, arbiter, frame, payload_of

from controller_apps.console.views import node_features_view
from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import Network
from controller_apps.packets import FiveTuple
from controller_apps.sessions.actions import Forward, Note, OpenPaths
from controller_apps.sessions.admission import Admission, find_light
from controller_apps.sessions.sessions import Sessions
from wire.features import EMIT, EVERYTHING, GATE, MEASURE, STORE, Feature, NodeFeatures
from wire.light import Role
from wire.metadata.decoding import decode
from wire.metadata.header import METADATA_PORT
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Reason, Service, Verdict
from wire.services import NEEDS, WANT_OF

ADDRESSES = {Role.OPENER: ALICE, Role.ACCEPTOR: BOB, Role.SOURCE: CHARLIE}
ABLE = NodeFeatures(EVERYTHING, 4_000_000)
CONNECTION = FiveTuple(ALICE, 40_000, BOB, METADATA_PORT)


def without(feature: Feature) -> NodeFeatures:
    """Return the features of a host that lacks a feature."""
    return NodeFeatures(EVERYTHING & ~feature, 0 if feature == STORE else 4_000_000)


def announced(report: dict[str, NodeFeatures | None]) -> Network:
    """Return the network of three hosts, of which these have announced their features."""
    found = Network({Q1})
    for port, host in FIBERS.items():
        node_features = report.get(host.address, ABLE)
        found.attach(SwitchPort(Q1, port), replace(host, node_features=node_features))
    return found


def admission(setup: Setup, network: Network) -> Admission:
    """Return what becomes of a request of alice to bob."""
    return find_light(setup, CONNECTION, Sessions(), network, 30_000)


def of(service: Service, **changes: object) -> Setup:
    """Return a request for a service."""
    return replace(FRAMED, service=service, **changes)  # type: ignore[arg-type]


LACKING = [
    (service, role, feature)
    for service, roles in NEEDS.items()
    for role, needed in roles.items()
    for feature in needed
    if role in ADDRESSES
]


@pytest.mark.parametrize(("service", "role", "feature"), LACKING)
def test_a_service_is_refused_where_a_host_lacks_what_its_part_needs(
    service: Service, role: Role, feature: Feature
) -> None:
    address = ADDRESSES[role]
    refused = admission(of(service), announced({address: without(feature)}))
    assert (refused.reason, refused.node) == (WANT_OF[feature], address)
    assert refused.detail.startswith(f"{address} lacks {str(feature.name).lower()}")


@pytest.mark.parametrize("service", [Service.SDC, Service.DISTRIBUTE, Service["TELEPORT"]])
def test_what_a_part_does_not_need_may_be_lacking(service: Service) -> None:
    needed = NEEDS[service]
    reports: dict[str, NodeFeatures | None] = {}
    for role, address in ADDRESSES.items():
        has = needed.get(role, Feature(0))
        reports[address] = NodeFeatures(has, 4_000_000 if STORE in has else 0)
    assert admission(of(service), announced(reports)).reason == Reason.OK


def test_a_host_that_tells_nothing_is_taken_to_be_able_to_everything() -> None:
    network = announced(dict.fromkeys((ALICE, BOB, CHARLIE)))
    granted = admission(of(Service["TELEPORT"]), network)
    assert (granted.reason, granted.block_pairs) == (Reason.OK, FRAMED.pairs)
    assert node_features_view(network) == {}


def test_blocks_are_no_larger_than_the_smallest_memory_that_keeps_them() -> None:
    small = {ALICE: NodeFeatures(EVERYTHING, 50), BOB: NodeFeatures(EVERYTHING, 32)}
    small[CHARLIE] = NodeFeatures(EVERYTHING, 7)  # keeps nothing
    network = announced(dict(small))
    assert admission(of(Service.DISTRIBUTE), network).block_pairs == 32
    assert admission(of(Service.DISTRIBUTE, pairs=20), network).block_pairs == 20
    assert admission(of(Service["BBM92"]), network).block_pairs == FRAMED.pairs  # nothing is kept


def test_ports_that_tell_different_things_are_believed_what_all_of_them_say() -> None:
    network = announced({})
    bob = replace(FIBERS[3], node_features=NodeFeatures(STORE | GATE, 10))
    network.attach(SwitchPort(Q1, 3), bob)
    assert network.node_features_of(BOB) == NodeFeatures(STORE | GATE, 10)
    refused = admission(of(Service.SDC), network)
    assert (refused.reason, refused.node) == (Reason.CANNOT_MEASURE, BOB)


@pytest.mark.parametrize("service", [Service.DISTRIBUTE, Service["TELEPORT"]])
def test_an_opener_that_is_its_own_source_needs_no_third_host(service: Service) -> None:
    setup = of(service, source=ALICE)
    granted = admission(setup, announced({CHARLIE: NodeFeatures(Feature(0), 0)}))
    assert granted.reason == Reason.OK
    (path,) = granted.paths
    assert path.leg == (SwitchPort(Q1, 1), SwitchPort(Q1, 2))  # alice's last fibre, bob's first
    refused = admission(setup, announced({ALICE: without(EMIT)}))
    assert (refused.reason, refused.node) == (Reason.CANNOT_EMIT, ALICE)


def test_superdense_coding_takes_no_source_that_is_one_of_its_ends() -> None:
    assert admission(of(Service.SDC, source=ALICE), announced({})).reason == Reason.NO_PATH


def verdict(setup: Setup, network: Network) -> tuple[list[object], Setup]:
    """Return what the arbiter does for alice's request to bob, and its answer."""
    judge = arbiter()
    judge.network.hosts = network.hosts
    actions = judge.segment_arrived(1, 1, frame(setup.encode()), 0.0)
    opened = [action for action in actions if isinstance(action, OpenPaths)]
    if opened:
        actions += judge.barrier_passed(Q1, opened[0].transaction, 1.0)
    (sent,) = [action for action in actions if isinstance(action, Forward)]
    answer = decode(payload_of(sent.frame))
    assert isinstance(answer, Setup)
    return list(actions), answer


def test_the_acceptor_is_told_which_host_lacks_what() -> None:
    actions, answer = verdict(of(Service["TELEPORT"]), announced({CHARLIE: without(EMIT)}))
    assert (answer.verdict, answer.reason) == (Verdict.REFUSED, Reason.CANNOT_EMIT)
    assert answer.source == CHARLIE
    _actions, answer = verdict(of(Service["TELEPORT"]), announced({BOB: without(MEASURE)}))
    assert (answer.reason, answer.source) == (Reason.CANNOT_MEASURE, BOB)
    (note,) = [action for action in actions if isinstance(action, Note)]
    assert note.detail == "CANNOT_EMIT: 10.0.0.3 lacks emit, which its source needs"


def test_the_acceptor_is_told_how_large_blocks_may_be_and_every_copy_says_the_same() -> None:
    small = announced({BOB: NodeFeatures(EVERYTHING, 32)})
    judge = arbiter()
    judge.network.hosts = small.hosts
    setup = of(Service.DISTRIBUTE)
    opened = judge.segment_arrived(1, 1, frame(setup.encode()), 0.0)
    (paths,) = [action for action in opened if isinstance(action, OpenPaths)]
    granted = judge.barrier_passed(Q1, paths.transaction, 1.0)
    again = judge.segment_arrived(1, 1, frame(setup.encode()), 1.1)
    frames = [a.frame for a in [*granted, *again] if isinstance(a, Forward)]
    assert len(frames) == 2
    assert frames[0] == frames[1]
    answer = decode(payload_of(frames[0]))
    assert answer == replace(setup, pairs=32, verdict=Verdict.GRANTED)


def test_a_request_that_has_waited_for_light_gets_blocks_that_fit_as_well() -> None:
    judge = arbiter(queues=True)
    judge.network.hosts = announced({BOB: NodeFeatures(EVERYTHING, 32)}).hosts
    first, second = of(Service.DISTRIBUTE), of(Service.DISTRIBUTE, session=8)
    (paths,) = opened(judge.segment_arrived(1, 1, frame(first.encode()), 0.0))
    judge.barrier_passed(Q1, paths.transaction, 0.1)
    assert not opened(judge.segment_arrived(1, 1, frame(second.encode(), sport=40001), 0.2))
    (paths,) = opened(judge.segment_arrived(1, 1, frame(flags="FA", seq=400), 0.3))
    granted = judge.barrier_passed(Q1, paths.transaction, 0.4)
    (sent,) = [action for action in granted if isinstance(action, Forward)]
    assert decode(payload_of(sent.frame)) == replace(second, pairs=32, verdict=Verdict.GRANTED)


def opened(actions: Sequence[object]) -> list[OpenPaths]:
    """Return which paths are opened, hops being among them."""
    return [action for action in actions if isinstance(action, OpenPaths) and action.hops]


def test_devices_are_shown_with_what_they_can_do() -> None:
    network = announced({BOB: NodeFeatures(STORE | MEASURE, 32), CHARLIE: None})
    view = node_features_view(network)
    assert view["bob"] == {"features": ["store", "measure"], "memory_qubits": 32}
    features = ["emit", "store", "gate", "measure", "herald", "interfere", "absorb"]
    assert view["alice"]["features"] == features
    assert "charlie" not in view
