"""Sizes of memories in switches, as the controller reads them in PORT_DESC."""

import struct
from types import SimpleNamespace

import pytest

from controller_apps.openflow.framework import parser
from controller_apps.openflow.optical_messages import is_inner, modes_of
from wire.optical import EXPERIMENTER
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


@pytest.mark.parametrize(
    ("experimenter", "words", "inner"),
    [(EXPERIMENTER, [], True), (EXPERIMENTER, [2 << 16, 1], True), (7, [2 << 16, 1, 9], False)],
)
def test_properties_of_others_and_short_ones_say_nothing_of_memories(
    experimenter: int, words: list[int], inner: bool
) -> None:
    data = struct.pack(f"!HHII{len(words)}I", 0xFFFF, 12 + 4 * len(words), experimenter, 1, *words)
    described, _rest = parser.OFPPortDescProp.parse(data + bytes(-len(data) % 8))
    port = SimpleNamespace(properties=[described])
    assert is_inner(port) == inner
    assert modes_of(port) is None
