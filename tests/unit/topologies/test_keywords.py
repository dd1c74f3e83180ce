"""A keyword that no node, switch, fibre or cable takes is refused by name, and not swallowed."""

from pathlib import Path
from typing import Any

import pytest
from mininet.node import Node

from topologies.links.copper_link import CopperLink
from topologies.links.fiber import FiberLink
from topologies.links.keywords import refuse_unknown
from topologies.nodes import (
    ClassicalHost,
    ClassicalSwitch,
    DispatcherHost,
    OpticalSwitch,
    QuantumController,
    QuantumHost,
)
from topologies.system.runs import runtime
from wire.config import QuantumSwitch
from wire.parameters.physics import BadParameter
from wire.parameters.switch import COMPOUND

SLIP = {"insertion_los_db": 9.0}


@pytest.mark.parametrize(
    ("kind", "given", "text"),
    [
        (OpticalSwitch, SLIP, "q1 has no insertion_los_db: did you mean insertion_loss_db?"),
        (OpticalSwitch, {"hardwear": "scpi://h"}, "q1 has no hardwear: did you mean hardware?"),
        (QuantumHost, {"detector": 1}, "q1 has no detector: did you mean detectors?"),
        (QuantumHost, {"gate": 1}, "q1 has no gate: did you mean gates?"),
        (ClassicalHost, {"defaultroute": "x"}, "q1 has no defaultroute: did you mean defaultRoute"),
        (DispatcherHost, {"memory": 1}, "q1 has no memory: "),
        (ClassicalSwitch, {"fail_mode": "secure"}, "did you mean failMode"),
        (QuantumController, {"polcy": "f"}, "q1 has no polcy: did you mean policy?"),
    ],
)
def test_a_slip_of_the_pen_is_named_before_a_node_is_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: type, given: dict[str, Any], text: str
) -> None:
    monkeypatch.setattr(runtime, "RUNTIME_ROOT", tmp_path)
    with pytest.raises(BadParameter) as caught:
        kind("q1", **given)
    assert text in str(caught.value)
    assert not any(tmp_path.iterdir())  # no network has begun


@pytest.mark.parametrize(
    ("kind", "given", "text"),
    [
        (FiberLink, {"lenght_km": 1}, "fibre a to b has no lenght_km: did you mean length_km?"),
        # Mininet's TCLink knows it, FiberLink never did anything about it.
        (FiberLink, {"delay": "5ms"}, "fibre a to b has no delay: "),
        (CopperLink, {"bw": 10}, "copper a to b has no bw: choose one of length_km"),
    ],
)
def test_a_slip_of_the_pen_is_named_before_a_link_is_made(
    kind: Any, given: dict[str, Any], text: str
) -> None:
    ends = [Node(name, inNamespace=False) for name in "ab"]
    try:
        with pytest.raises(BadParameter) as caught:
            kind(*ends, **given)
    finally:
        for end in ends:
            end.terminate()
    assert text in str(caught.value)


class Router(QuantumHost):
    """A host of a user's own, made as Mininet's examples make theirs."""

    def __init__(self, name: str, vlan: int = 1, **params: Any) -> None:
        super().__init__(name, **params)

    def config(  # type: ignore[override]  # as Mininet's own examples do
        self, mtu: int = 1500, **params: Any
    ) -> dict[str, object]:
        """Take a keyword of its own, too."""
        return super().config(**params)


def test_what_mininet_and_subclasses_take_is_taken() -> None:
    mininets = ["ip", "mac", "defaultRoute", "lo", "privateDirs", "inNamespace", "cores"]
    refuse_unknown("dave", [*mininets, "vlan", "mtu", "device", "memory"], Router)
    refuse_unknown("q1", ["dpid", "listenPort", "batch", "isSwitch", "stp"], OpticalSwitch)
    with pytest.raises(BadParameter, match=r"dave has no vlan_id: did you mean vlan\?"):
        Router("dave", vlan_id=2)


def test_every_field_of_the_switchs_optics_is_a_keyword() -> None:
    """A field that OpticalSwitch does not hand on would be refused with the wrong range or not."""
    make: Any = OpticalSwitch
    for name, value in vars(QuantumSwitch("q1")).items():
        if name in ("name", "paths"):
            continue
        is_part = name in COMPOUND
        problem = " is not a" if is_part else ": choose"
        with pytest.raises(ValueError, match=f"{name} 'much'{problem}"):
            make("q1", **{name: "much"})
        assert is_part or value is None or isinstance(value, int | float)
