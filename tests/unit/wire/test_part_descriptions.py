"""Properties of inner ports in PORT_DESC: the bytes that docs/inner-ports.md names."""

from dataclasses import replace

from wire.parameters.physics import (
    BellAnalyser,
    Detectors,
    Device,
    Emitter,
    Gates,
    Memory,
    PairSource,
)
from wire.parameters.switch import InnerPort, Kind
from wire.part_descriptions import describe

OURS = "00514d4e00000001"  # experimenter and its type
DETECTORS = Detectors(efficiency=0.8, dark_count_hz=100.5, gate_s=1e-9)
PARTS = Device(
    analyser=BellAnalyser("gates", visibility=0.95),
    detectors=DETECTORS,
    gates=Gates(two_qubit_depolarizing=0.01),
    memory=Memory(capacity=9, efficiency=0.5, t1_s=1.0, t2_s=2.0),
    source=PairSource("poisson", mean_pairs=0.1, fidelity=0.97, max_rate_hz=5e9),
    emitter=Emitter("single-click", 0.5, bright_state=0.05, fidelity=0.9, modes=20),
)


def described(kind: Kind, number: int, which: int = 0, parts: Device = PARTS) -> str:
    return describe(InnerPort(kind, number, which), parts).hex()


def test_an_analyser_is_of_gates_and_a_station_of_linear_optics() -> None:
    begin, rest = "ffff0030" + OURS, "000c3500000e7ef000002710000003e80000000000018894"
    assert described(Kind.ANALYSER, 2, 1) == begin + "000100010000000200000003" + rest
    linear = replace(PARTS, analyser=BellAnalyser("linear", visibility=0.95))
    station = described(Kind.ANALYSER, 2, 2, linear)
    assert station == begin + "000500020000000200000002" + rest


def test_a_memory_says_its_modes_efficiency_and_times() -> None:
    assert (
        described(Kind.MEMORY, 3)
        == (
            "ffff0034" + OURS + "0002000000000003"  # 52 bytes, of kind 2, the third
            "000000090007a120000000003b9aca000000000077359400ffffffffffffffff00000000"
        )
    )


def test_a_source_says_its_pairs_their_states_and_its_rate() -> None:
    assert (
        described(Kind.SOURCE, 1, 2)
        == (
            "ffff0034" + OURS + "0003000200000001"
            "00000002000186a0"  # poisson, 0.1
            "000ecd10000027100000271000002710"  # of the other Bell states 0.01 each
            "000000012a05f20000000000"
        )
    )
    single = replace(PARTS, source=PairSource(bell_diagonal=(0.7, 0.3, 0.0, 0.0)))
    assert described(Kind.SOURCE, 1, 1, single)[40:88] == (
        "00000001000f4240000aae60000493e00000000000000000"
    )


def test_an_emitter_says_how_its_memory_emits() -> None:
    prepared = replace(PARTS, emitter=replace(PARTS.emitter, preparation_s=5.5e-6))
    assert described(Kind.EMITTER, 2, parts=prepared) == (
        "ffff0030" + OURS + "0004000000000002"
        "00000002000000140007a1200000c350000dbba0000000000000157c"
    )
