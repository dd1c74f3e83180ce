"""Sizes of memories in switches, as the controller reads them in PORT_DESC."""

from types import SimpleNamespace

import pytest

from controller_apps.openflow.framework import parser
from controller_apps.openflow.optical_messages import is_inner, modes_of
from wire.parameters.physics import Device, Emitter, Memory, PairSource
from wire.parameters.switch import InnerPort, Kind
from wire.part_descriptions import describe

PARTS = Device(
    memory=Memory(capacity=9),
    source=PairSource("poisson", mean_pairs=0.1),
    emitter=Emitter("single-click", 0.5, modes=20),
)


@pytest.mark.parametrize("kind", Kind)
def test_a_memory_alone_says_how_many_qubits_it_takes(kind: Kind) -> None:
    described, rest = parser.OFPPortDescProp.parse(describe(InnerPort(kind, 1, 1), PARTS))
    port = SimpleNamespace(properties=[described])
    assert not rest
    assert is_inner(port)
    assert modes_of(port) == (9 if kind == Kind.MEMORY else None)
