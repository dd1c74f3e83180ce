"""Bell measurements: teleportation and swapping by imperfect pairs, CHSH, gates, interference.

Werner pairs of fidelity F are made as experiments have them: half of a perfect pair passes a
fibre that depolarises with p = 4 (1 - F)/3.
"""

import math

import numpy as np

from evidence.curves import theory
from evidence.curves.estimates import Estimate, proportion
from evidence.curves.experiment import Outcome
from evidence.curves.link import (
    BASES,
    PLAIN,
    TESTED,
    Ends,
    blocks,
    fiber,
    fidelity,
    link,
    measured,
    network,
    share,
)
from evidence.curves.parameters import Point
from evidence.curves.superdense import transmit
from evidence.laboratory import Laboratory, LaboratoryHost
from wire.dispatcher_pb2 import CreateRequest, Gate
from wire.outcomes import NO_CLICK
from wire.parameters.physics import BellAnalyser, Device, Gates, Memory, PairSource

IDENTITY, FLIP = 0, 1
H, S, S_DAG = (Gate(name=name) for name in (Gate.H, Gate.S, Gate.S_DAG))
# How each cardinal state is made of |0>, and brought back to |0> or |1>.
CARDINAL: list[tuple[int, list[Gate], list[Gate]]] = [
    (pauli, gates, back)
    for pauli in (IDENTITY, FLIP)
    for gates, back in (([], []), ([H], [H]), ([H, S], [S_DAG, H]))
]
# Angle of alice, angle of bob, and the sign of their correlation in S. The angles suit Phi+ best;
# they are not Clifford gates: state vectors simulate this.
SETTINGS = (
    *((0, math.pi / 4, 1), (0, -math.pi / 4, 1)),
    *((math.pi / 2, math.pi / 4, 1), (math.pi / 2, -math.pi / 4, -1)),
)
BELL_STATES = {"psi_plus": 1, "phi_minus": 2, "psi_minus": 3}  # wrong outcomes of Phi+
PHI_MINUS = 2
MEETING_KM = 2.0  # of the shorter one of two ways
PS_PER_S = 1e12

Theory = dict[str, float]


async def teleport(v: Point, seed: int) -> Outcome:
    """Teleport each cardinal state equally often and count how often it comes out right."""
    laboratory = link({"depolarizing": theory.of_fidelity(v.fidelity)}, seed)
    alice, bob = laboratory.host("alice"), laboratory.host("bob")
    each = int(v.pairs) // len(CARDINAL)
    right = 0
    for number, (pauli, gates, back) in enumerate(CARDINAL):
        pair, state = 2 * number, 2 * number + 1
        await share(alice, bob, each, pair)
        await alice.create(each, state, CreateRequest.ZEROS)
        await alice.apply((state, 0), np.full(each, pauli, np.uint8), gates)
        correction = await alice.bell_measure((state, 0), (pair, 0))
        await bob.apply((pair, 1), correction, back)
        right += int(np.count_nonzero(await bob.measure((pair, 1)) == pauli))
    return {"teleported": proportion(right, each * len(CARDINAL))}


def teleported(v: Point) -> Theory:
    return {"teleported": theory.teleported_fidelity(v.fidelity)}


async def swap(v: Point, seed: int) -> Outcome:
    """Join pairs charlie-alice and charlie-bob; measure the fidelity of alice-bob with Phi+."""
    fidelities = {"alice": v.first_fidelity, "bob": v.second_fidelity}
    ways = {name: (f"charlie-q{i}", f"{name}-q0") for i, name in enumerate(fidelities)}
    noise = [theory.of_fidelity(each) for each in fidelities.values()]
    fibers = [fiber(*way, depolarizing=p) for way, p in zip(ways.values(), noise, strict=True)]
    laboratory, pairs = network(seed, fibers), int(v.pairs) // len(BASES)
    charlie = laboratory.host("charlie")

    async def joined(turn: int) -> Ends:
        ends = [(laboratory.host(name), (2 * turn + i, 1)) for i, name in enumerate(ways)]
        for host, (block, _half) in ends:
            await share(charlie, host, pairs, block, ways[host.name])
        return await joined_at(charlie, ends)

    return {"swapped": await fidelity(joined)}


async def joined_at(repeater: LaboratoryHost, ends: Ends) -> Ends:
    """Swap pairs of the repeater with both ends; the second one corrects its half."""
    (_first, (one, _)), (second, (other, half)) = ends
    await second.apply((other, half), await repeater.bell_measure((one, 0), (other, 0)))
    return ends


def swapped(v: Point) -> Theory:
    return {"swapped": theory.swapped_fidelity(v.first_fidelity, v.second_fidelity)}


async def gated_swap(v: Point, seed: int) -> Outcome:
    """Swap at a repeater by gates, which err and take time, as its readings do."""
    gates = Gates(
        "any",
        one_qubit_depolarizing=v.one_qubit_depolarizing,
        two_qubit_depolarizing=v.two_qubit_depolarizing,
        two_qubit_s=v.two_qubit_s,
        readout_s=v.readout_s,
        readout_error=v.readout_error,
    )
    end = Device(memory=Memory(t2_s=v.t2_s))
    ways = {"alice": ("r1-q0", "alice-q0"), "bob": ("r1-q1", "bob-q0")}
    fibers = [fiber(*way, length_km=0.0) for way in ways.values()]
    middle = Device(gates=gates, analyser=BellAnalyser("gates"))
    laboratory = network(seed, fibers, alice=end, bob=end, r1=middle)
    pairs = int(v.pairs) // len(BASES)
    repeater = laboratory.host("r1")

    async def joined(turn: int) -> Ends:
        ends = [(laboratory.host(name), (2 * turn + i, 1)) for i, name in enumerate(ways)]
        for host, (block, _half) in ends:
            near, far = ways[host.name]
            await repeater.create(pairs, block)
            await repeater.store((block, 0))
            await repeater.send({(block, 1): near})
            await host.receive((block, 1), far)
        for host, block_key in ends:
            await host.store(block_key)
        return await joined_at(repeater, ends)

    return {"fidelity": await fidelity(joined)}


def of_gated_swap(v: Point) -> Theory:
    """Both ends decohere while the gate and the readings last."""
    coherence = math.exp(-2 * (v.two_qubit_s + v.readout_s) / v.t2_s)
    fidelity = theory.gated_swap_fidelity(
        v.one_qubit_depolarizing, v.two_qubit_depolarizing, v.readout_error, coherence
    )
    return {"fidelity": fidelity}


async def chsh(v: Point, seed: int) -> Outcome:
    laboratory = link({"depolarizing": theory.of_fidelity(v.fidelity)}, seed)
    pairs = int(v.pairs) // len(SETTINGS)
    s, variance = 0.0, 0.0
    for block, (mine, yours, sign) in enumerate(SETTINGS):
        agreeing = await correlated(laboratory, block, pairs, (mine, yours))
        s += sign * (2 * agreeing.value - 1)
        variance += (2 * agreeing.error) ** 2
    return {"chsh": Estimate(s, variance**0.5)}


async def correlated(
    laboratory: Laboratory, block: int, pairs: int, angles: tuple[float, float]
) -> Estimate:
    """Return how often both see the same when each measures along an angle from Z towards X."""
    alice, bob = laboratory.host("alice"), laboratory.host("bob")
    await share(alice, bob, pairs, block)
    ends = (alice, (block, 0)), (bob, (block, 1))
    for (host, half), angle in zip(ends, angles, strict=True):
        await host.apply(half, gates=[Gate(name=Gate.RY, angle_rad=-angle)])
    mine, yours = await measured(ends)
    return proportion(int(np.count_nonzero(mine == yours)), pairs)


def of_chsh(v: Point) -> Theory:
    return {"chsh": theory.chsh(v.fidelity)}


async def gated_bell(v: Point, seed: int) -> Outcome:
    """Measure perfect pairs by a CX, an H and two readings; count the Bell states found."""
    gates = Gates("any", v.one_qubit_depolarizing, v.two_qubit_depolarizing)
    device = Device(gates=gates, analyser=BellAnalyser("gates"))
    alice = network(seed, [], alice=device).host("alice")
    counts = np.zeros(4, np.int64)
    for block, size in blocks(v.pairs):
        await alice.create(size, block)
        counts += np.bincount(await alice.bell_measure((block, 0), (block, 1)), minlength=4)
    by_state, pairs = counts.tolist(), int(counts.sum())
    return {name: proportion(by_state[state], pairs) for name, state in BELL_STATES.items()}


def of_gated_bell(v: Point) -> Theory:
    likely = theory.gated_bell_outcomes(v.one_qubit_depolarizing, v.two_qubit_depolarizing)
    return {name: likely[state] for name, state in BELL_STATES.items()}


async def hom(v: Point, seed: int) -> Outcome:
    """Count how often Phi+ is taken for Phi- by an analyser without a delay line.

    Distinguishable photons give the wrong phase, with the probability of a coincidence in a
    Hong-Ou-Mandel interferometer.
    """
    later_km = v.delay_ps / PS_PER_S * theory.SPEED_IN_FIBER_M_PER_S / 1e3
    length_km = MEETING_KM + later_km
    dispersion = v.dispersion_ps_per_nm / length_km
    tested = fiber(*TESTED, length_km=length_km, dispersion_ps_per_nm_km=dispersion)
    analyser = BellAnalyser(
        visibility=v.visibility, bandwidth_rad_per_s=v.bandwidth_rad_per_s, delay_line_km=0.0
    )
    source = PairSource(bandwidth_nm=v.bandwidth_nm)
    fibers = [tested, fiber(*PLAIN, length_km=MEETING_KM)]
    laboratory = network(seed, fibers, alice=Device(source), bob=Device(analyser=analyser))
    wrong = pairs = 0
    for block, size in blocks(v.pairs):
        received = await transmit(laboratory, block, np.zeros(size, np.uint8))
        wrong += int(np.count_nonzero(received == PHI_MINUS))
        pairs += size
    return {"coincidences": proportion(wrong, pairs)}


def of_hom(v: Point) -> Theory:
    width = v.bandwidth_rad_per_s or theory.rad_per_s(v.bandwidth_nm)
    chirp_s2 = v.dispersion_ps_per_nm / PS_PER_S / theory.rad_per_s(1.0)
    return {
        "coincidences": theory.coincidences(v.delay_ps / PS_PER_S, v.visibility, width, chirp_s2)
    }


async def delay_line(v: Point, seed: int) -> Outcome:
    """Send both halves of pairs over lossless ways, and count coincidences."""
    fibers = [fiber(*TESTED, length_km=1.0 + v.difference_km), fiber(*PLAIN, length_km=1.0)]
    analyser = BellAnalyser(delay_line_db_per_km=v.delay_line_db_per_km)
    laboratory = network(seed, fibers, bob=Device(analyser=analyser))
    seen = pairs = 0
    for block, size in blocks(v.pairs):
        outcomes = await transmit(laboratory, block, np.zeros(size, np.uint8))
        seen, pairs = seen + int(np.count_nonzero(outcomes != NO_CLICK)), pairs + size
    return {"coincidences": proportion(seen, pairs)}


def of_delay_line(v: Point) -> Theory:
    return {"coincidences": theory.transmission(v.delay_line_db_per_km * v.difference_km)}
