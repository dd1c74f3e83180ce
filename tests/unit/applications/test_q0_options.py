"""The option `--q0`, and the networks it is for."""

import argparse

import pytest

from applications.ip_over_light.interfaces import IpOverLight
from applications.ip_over_light.options import Q0Options, ip_over_light, with_both_ways
from qmn.network.description import describe_network
from qmn.network.options import NetworkOptions
from qmn.network.topologies import TOPOLOGIES
from qmn.options import BadInput, add_options, read


def parsed(*words: str) -> Q0Options:
    parser = argparse.ArgumentParser()
    add_options(parser, Q0Options)
    return read(Q0Options, parser.parse_args(words))


def test_there_is_none_unless_it_is_asked_for() -> None:
    assert ip_over_light(parsed("--q0-fec=golay")) is None


def test_options_say_what_its_sessions_are_like() -> None:
    words = ["--q0", "--q0-mtu=1500", "--q0-fec=golay", "--q0-interleave", "--q0-frame-bytes=64"]
    sessions = {"fec": "golay", "interleave": True, "frame_bytes": 64}
    assert ip_over_light(parsed(*words)) == IpOverLight(mtu=1500, sessions=sessions)


@pytest.mark.parametrize("words", ["--q0-mtu=575", "--q0-mtu=65536", "--q0-frame-bytes=0"])
def test_what_cannot_be_is_refused(words: str) -> None:
    with pytest.raises(BadInput, match=r"choose \d+ to \d+"):
        ip_over_light(parsed("--q0", words))


@pytest.mark.parametrize(
    "name", [name for name, each in TOPOLOGIES.items() if "both_ways" in each.parameters]
)
def test_alice_gets_a_second_fibre_where_she_has_one(name: str) -> None:
    def fibers(options: NetworkOptions) -> int:
        links = describe_network(options).topo.links()
        return sum("alice" in link and "s1" not in link for link in links)

    plain = NetworkOptions(topology=name)
    assert fibers(plain) == 1
    assert fibers(with_both_ways(Q0Options(q0=True), plain)) == 2


def test_other_networks_stay_as_they_are() -> None:
    plain = NetworkOptions(topology="repeaters")
    assert with_both_ways(Q0Options(q0=True), plain) == plain
