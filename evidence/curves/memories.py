"""Pairs in memories: stored until all have come or are handed over, heralded, dropped when old."""

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from evidence.curves import theory
from evidence.curves.estimates import Estimate, proportion
from evidence.curves.experiment import Outcome
from evidence.curves.link import TESTED, Ends, configuration, fiber, measured, network
from evidence.curves.parameters import Point
from evidence.laboratory import RATE_HZ, Laboratory
from hosts.middleware.services.distribution.fidelity import Estimate as Sampled
from hosts.middleware.session.values import Lifetimes
from wire.dispatcher_pb2 import BellOutcomes, MeasureRequest
from wire.parameters.fiber import Fiber, FiberEnd, optics
from wire.parameters.physics import BellAnalyser, Device, Emitter, Memory, PairSource
from wire.parameters.switch import FIRST_INNER_PORT, QuantumSwitch

STORED_PAIRS = 1_000  # in a block
SAMPLED_PAIRS = 3_000  # in 3 us: the first has not waited for the last
AGREEMENTS = {"xx": MeasureRequest.X, "zz": MeasureRequest.Z}
PORTS = {"alice": "alice-q0", "bob": "bob-q0"}
MAX_S = 60.0
ROUNDS = 1_000  # of attempts that all pairs take, about: modes are as many as that needs
MAX_MODES = 1_000_000
PSI_MINUS = 3
ATTEMPT_S, ATTEMPT_KM = 1e-3, 0.01
BOTH = 2
FAIR = 0.5

Theory = dict[str, float]


async def fresh_outcomes(v: Point, seed: int) -> Outcome:
    """Measure half of each pair in X; count how often two blocks in a row say the same."""
    alice, uses = network(seed, []).host("alice"), int(v.uses)
    size, outcomes = int(v.pairs) // uses, []
    for _ in range(uses):
        await alice.create(size)
        outcomes.append(await alice.measure((0, 0), MeasureRequest.X))
        await alice.discard((0, 1))
    equal = sum(np.count_nonzero(a == b) for a, b in pairwise(outcomes))
    return {"equal": proportion(int(equal), size * (uses - 1))}


def fair(_v: Point) -> Theory:
    return {"equal": FAIR}


async def decoherence(v: Point, seed: int) -> Outcome:
    """Store both halves as they come, or neither; count how often they agree in X and in Z."""
    end = Device(memory=Memory(t1_s=v.t1_s, t2_s=v.t2_s))
    laboratory = network(seed, [fiber(*TESTED)], alice=end, bob=end)
    count = int(v.pairs) // STORED_PAIRS // len(AGREEMENTS)
    agreeing = dict.fromkeys(AGREEMENTS, 0)
    for block in range(count * len(AGREEMENTS)):
        name = list(AGREEMENTS)[block % len(AGREEMENTS)]
        ends = await _stored(laboratory, STORED_PAIRS, block, int(v.rate_hz), bool(v.stored))
        mine, yours = await measured(ends, AGREEMENTS[name])
        agreeing[name] += int(np.count_nonzero(mine == yours))
    return {name: proportion(each, count * STORED_PAIRS) for name, each in agreeing.items()}


def agreements(v: Point) -> Theory:
    """Either half waits for the last pair; alice's also while the other one flies."""
    flight_s = fiber(*TESTED).delay_s
    last = [(STORED_PAIRS - 1 - pair) / v.rate_hz for pair in range(STORED_PAIRS)]
    waits = [(waited_s + flight_s, waited_s) for waited_s in last]
    return {
        "xx": theory.agreement_in_x(waits, v.t2_s),
        "zz": theory.agreement_in_z(waits, v.t1_s),
    }


async def _stored(
    laboratory: Laboratory, pairs: int, block: int, rate_hz: int = RATE_HZ, stored: bool = True
) -> Ends:
    """Give both hosts halves of pairs; those that nobody stores wait there as well."""
    alice, bob = laboratory.host("alice"), laboratory.host("bob")
    await alice.create(pairs, block)
    if stored:
        await alice.store((block, 0))
    await alice.send({(block, 1): TESTED[0]}, rate_hz)
    await bob.receive((block, 1), TESTED[1])
    if stored:
        await bob.store((block, 1))
    return (alice, (block, 0)), (bob, (block, 1))


async def fidelity_age(v: Point, seed: int) -> Outcome:
    """Measure every other block at once, and those that are handed over when they have waited.

    The sample's estimate is given as measured, and as expected at delivery.
    """
    memory = Memory(t1_s=v.t1_s, t2_s=v.t2_s)
    alice = Device(source=PairSource(fidelity=v.fidelity), memory=memory)
    fibers = [fiber(*TESTED, length_km=0.0)]
    laboratory = network(seed, fibers, alice=alice, bob=Device(memory=memory))
    sampled, delivered = Sampled(), Sampled()
    bases = (np.arange(SAMPLED_PAIRS) % 3).astype(np.uint8)
    for block in range(int(v.pairs) // SAMPLED_PAIRS):
        ends = await _stored(laboratory, SAMPLED_PAIRS, block)
        if block % 2:
            await laboratory.wait(v.waited_s)
        (delivered if block % 2 else sampled).add(bases, *await measured(ends, bases=bases))
    lifetimes = Lifetimes(memory.t1_s, memory.t2_s, memory.depolarizing_s, memory.cutoff_s)
    at_delivery = sampled.after(v.waited_s, (lifetimes, lifetimes))
    return {
        "estimate": Estimate(sampled.fidelity or math.nan, _error(sampled)),
        "expected": Estimate(at_delivery or math.nan, _error(sampled)),
        "delivered": Estimate(delivered.fidelity or math.nan, _error(delivered)),
    }


def _error(sampled: Sampled) -> float:
    """Return the standard error of a fidelity, the sum of three shares of a half each."""
    counts = zip(sampled.right, sampled.measured, strict=True)
    return _spread(*(proportion(int(right), int(pairs)) for right, pairs in counts))


def _spread(*shares: Estimate) -> float:
    return math.hypot(*(share.error for share in shares)) / 2


def of_fidelity_age(v: Point) -> Theory:
    """Of Werner pairs both halves wait, and lose coherence and relax, until they are delivered."""
    werner = (4 * v.fidelity - 1) / 3
    coherent, excited = math.exp(-2 * v.waited_s / v.t2_s), math.exp(-v.waited_s / v.t1_s)
    in_z = excited**2 * werner + (1 - excited) ** 2
    delivered = (1 + 2 * coherent * werner + in_z) / 4
    return {"estimate": v.fidelity, "expected": delivered, "delivered": delivered}


async def heralding(v: Point, seed: int) -> Outcome:
    """Herald pairs at a station in the middle, and measure a third of them in each basis."""
    chance, count = _heralds(v)[0], int(v.pairs)
    emitter = Emitter(
        str(v["scheme"]),
        v.efficiency,
        v.bright_state,
        modes=min(max(int(count / chance / ROUNDS), 1), MAX_MODES),
    )
    way = {"length_km": v.arm_km, "loss_db_per_km": v.loss_db_per_km}
    at_q1 = Device(analyser=BellAnalyser("linear", visibility=v.visibility))
    laboratory = await station(seed, way, Device(emitter=emitter), at_q1)
    reply, took_s, ends = await heralded(laboratory, count, 0)
    heralds = np.frombuffer(reply.outcomes, np.uint8)
    each = proportion(heralds.size, reply.attempts)
    per_s = reply.attempts / emitter.modes / took_s
    rate = Estimate(each.value * per_s, each.error * per_s)
    bases = (np.arange(heralds.size) % 3).astype(np.uint8)
    mine, yours = await measured(ends, bases=bases)
    differ = np.where(bases == 0, 1, heralds == PSI_MINUS)  # Psi+ is alike in X and Y, not in Z
    right = (mine ^ yours) == differ
    shares = [proportion(int(right[bases == b].sum()), int((bases == b).sum())) for b in range(3)]
    value = (1 + sum(2 * share.value - 1 for share in shares)) / 4
    return {"rate": rate, "fidelity": Estimate(value, _spread(*shares))}


async def station(seed: int, values: dict[str, Any], host: Device, station: Device) -> Laboratory:
    """Return a network of alice, bob, and a switch between them with such a station."""
    way = optics("a fibre", **values)
    inputs = {number: FIRST_INNER_PORT + number - 1 for number in range(1, 1 + len(PORTS))}
    fibers = [
        Fiber.joining(FiberEnd(name, port), FiberEnd("q1", str(number)), way)
        for number, (name, port) in zip(inputs, PORTS.items(), strict=True)
    ]
    analyser, detectors = station.analyser, station.detectors
    q1 = QuantumSwitch("q1", analysers=1, analyser=analyser, detectors=detectors)
    config = configuration(seed, fibers, dict.fromkeys(PORTS, host))
    laboratory = Laboratory(replace(config, switches=[q1]))
    await laboratory.connect("q1", inputs)
    await laboratory.wait(q1.switching_time_s)
    return laboratory


async def heralded(
    laboratory: Laboratory, count: int, block: int
) -> tuple[BellOutcomes, float, Ends]:
    """Herald pairs of alice and bob, who emit until there are as many; also return how long."""
    heralds, took_s = await laboratory.heralded("q1", PORTS, count, block, timeout_s=MAX_S)
    ends = [(laboratory.host(name), (block, half)) for half, name in enumerate(PORTS)]
    return heralds, took_s, ends


def _heralds(v: Point) -> tuple[float, float]:
    """Return how likely an attempt is heralded, and the fidelity it then has, in theory."""
    light = v.efficiency * theory.transmission(v.loss_db_per_km * v.arm_km)
    if v["scheme"] == "two-click":
        return theory.two_clicks(light, v.visibility)
    return theory.single_click(light, v.bright_state, v.visibility)


def of_heralding(v: Point) -> Theory:
    """Return the rate p c / 2L of one mode, L the way to the station, and the fidelity."""
    chance, fidelity = _heralds(v)
    delay_s = optics("a fibre", length_km=v.arm_km).delay_s
    return {"rate": chance / (2 * delay_s), "fidelity": fidelity}


async def cutoff(v: Point, seed: int) -> Outcome:
    """Herald two pairs again and again, and measure them in X as soon as both are there.

    None of them is older than the cut-off.
    """
    emitter = Emitter("two-click", v.efficiency, preparation_s=ATTEMPT_S)
    host = Device(memory=Memory(t2_s=v.t2_s, cutoff_s=v.cutoff_s), emitter=emitter)
    laboratory = await station(
        seed, {"length_km": ATTEMPT_KM}, host, Device(analyser=BellAnalyser("linear"))
    )
    attempts, right = [], 0
    for block in range(int(v.pairs) // BOTH):
        heralds, _took_s, ends = await heralded(laboratory, BOTH, block)
        attempts.append(heralds.attempts)
        mine, yours = await measured(ends, MeasureRequest.X)
        right += int((mine[0] ^ yours[0]) == (heralds.outcomes[0] == PSI_MINUS))
    mean = float(np.mean(attempts))
    error = float(np.std(attempts, ddof=1)) / math.sqrt(len(attempts))
    rate = 1 / (mean * _attempt_s())
    # T2 alone: of Psi+ or Psi-, and never of another Bell state.
    share = proportion(right, len(attempts))
    return {"rate": Estimate(rate, rate * error / mean), "fidelity": share}


def of_cutoff(v: Point) -> Theory:
    """The second may be some attempts behind the first, and also waits for its clicks."""
    chance, attempt_s, rounds = theory.two_clicks(v.efficiency, 1.0)[0], _attempt_s(), v.cutoff_s
    if not math.isinf(rounds):
        rounds = math.floor((v.cutoff_s - _flight_s()) / attempt_s + 1e-9)
    coherence = theory.kept_over_gap(chance, rounds, math.exp(-2 * attempt_s / v.t2_s))
    rate = 1 / (theory.attempts_until_two(chance, rounds) * attempt_s)
    return {"rate": rate, "fidelity": (1 + coherence) / 2}


def _flight_s() -> float:
    return optics("a fibre", length_km=ATTEMPT_KM).delay_s


def _attempt_s() -> float:
    return ATTEMPT_S + 2 * _flight_s()
