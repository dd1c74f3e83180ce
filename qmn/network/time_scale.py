"""How time of a network passes: stepped, or paced by the wall at a scale that auto chooses."""

import argparse
import os
from collections.abc import Iterator
from dataclasses import dataclass
from math import inf

from qmn.timeouts import MOST_ROUND_TRIP_S
from topologies.description.description import Description
from wire.network_time import LEAST_SCALE, MOST_SCALE, NetworkTime

PACED, STEPPED = "paced", "stepped"
REAL, AUTO = 1.0, "auto"
# Time of programs from the arrival of a photon to what a host does next with it, and the bits
# from its peer: 5 to 20 ms of idle processors, by `software_s` of runs on two cores.
SOFTWARE_S = 0.02
SHARE = 0.01  # of the shortest time, that software may take


@dataclass(frozen=True)
class Pace:
    """How the time of a network passes, and why."""

    scale: float = REAL  # seconds here for one of the network
    reason: str = ""  # empty: somebody has named it, or it is usual
    shortest: tuple[str, float] | None = None  # of the network's times, and its name
    stepped: bool = False


def scale(text: str) -> float | str:
    """Return the scale of a word; raise ArgumentTypeError if it is none."""
    if text == AUTO:
        return AUTO
    try:
        return NetworkTime(float(text)).scale
    except ValueError as error:
        raise argparse.ArgumentTypeError(
            f"{text}: choose {LEAST_SCALE:g} to {MOST_SCALE:g} seconds here for one second of the "
            f"network, or {AUTO}"
        ) from error


def pace(text: str) -> str:
    """Return what the command line says: stepped, paced, or paced=K; raise ArgumentTypeError."""
    mode, equals, named = text.partition("=")
    if text != STEPPED and mode != PACED:
        raise argparse.ArgumentTypeError(f"{text}: choose {STEPPED}, {PACED} or {PACED}=K")
    return f"{PACED}={scale(named)}" if equals else text


def scale_of(given: float | str, network: Description, round_trip_s: float = 0.0) -> Pace:
    """Return the time scale of a network; `auto` goes by the shortest of its times.

    `round_trip_s` is the longest of packets along its copper: TCP is to live through it.
    """
    name, shortest_s = min(times(network), key=lambda each: each[1], default=("", inf))
    shortest = None if shortest_s == inf else (name, shortest_s)
    if isinstance(given, float):
        return Pace(given, shortest=shortest)
    if shortest is None:
        return Pace(REAL, "nothing in this network has a time of its own")
    software_s = SOFTWARE_S * max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1))
    needed = max(REAL, software_s / (SHARE * shortest_s))
    most = max(REAL, min(MOST_SCALE, MOST_ROUND_TRIP_S / round_trip_s if round_trip_s else inf))
    reason = (
        f"{software_s * 1e3:.3g} ms of software are {SHARE:.0%} of {name}, "
        f"{shortest_s:.3g} s, the shortest time of this network"
    )
    if needed > most:
        reason = (
            f"{SHARE:.0%} cannot be reached: {software_s * 1e3:.3g} ms of software are "
            f"{100 * software_s / most / shortest_s:.3g}% of {name}, {shortest_s:.3g} s; that "
            f"takes {needed:.3g}, and up to {most:.3g} a packet and its answer take no more than "
            f"the {MOST_ROUND_TRIP_S:g} s here that TCP lives through"
        )
    return Pace(float(f"{min(needed, most):.3g}"), reason, shortest)


def times(network: Description) -> Iterator[tuple[str, float]]:
    for host, device in network.hosts.items():
        yield f"T1 of {host}", device.memory.t1_s
        yield f"T2 of {host}", device.memory.t2_s
        yield f"depolarizing_s of {host}", device.memory.depolarizing_s
        yield f"retrieval_s of {host}", device.memory.retrieval_s
        yield f"cutoff_s of {host}", device.memory.cutoff_s
    for fiber in network.fibers:
        if fiber.optics.delay_s:
            yield f"the fibre from {fiber.a} to {fiber.b}", fiber.optics.delay_s
