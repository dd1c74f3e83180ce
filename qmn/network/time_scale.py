"""How slowly a network runs: `--time-scale K`, or auto, which chooses K by the network."""

import argparse
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from mininet.topo import Topo

from topologies.fiber import OPTICS, FiberLink
from topologies.nodes import QuantumHost, device_of
from wire.network_time import NetworkTime
from wire.parameters.fiber import optics

REAL, AUTO = 1.0, "auto"
# What programs need from the arrival of a photon to what a host does next with it, and the bits
# from its peer: 5 to 20 ms of idle processors, by `software_s` of runs on two cores.
SOFTWARE_S = 0.02
SHARE = 0.01  # of the shortest time, that software may take


@dataclass(frozen=True)
class Scale:
    """A time scale, and why it is that."""

    scale: float
    reason: str = ""  # empty: somebody has named it


def scale(text: str) -> float | str:
    """Return what the command line says; raise ArgumentTypeError for what no scale is."""
    if text == AUTO:
        return AUTO
    try:
        return NetworkTime(float(text)).scale
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text}: {error}, or {AUTO}") from error


def scale_of(given: float | str, topo: Callable[[], Topo]) -> Scale:
    """Return the time scale of a network; `auto` goes by the shortest of its times."""
    if isinstance(given, float):
        return Scale(given)
    name, shortest_s = min(times(topo()), key=lambda each: each[1], default=("", float("inf")))
    if shortest_s == float("inf"):
        return Scale(REAL, "nothing in this network has a time of its own")
    busy = max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1))
    needed = max(REAL, busy * SOFTWARE_S / (SHARE * shortest_s))
    reason = (
        f"{busy * SOFTWARE_S * 1e3:.3g} ms of software are {SHARE:.0%} of {name}, "
        f"{shortest_s:.3g} s, the shortest time of this network"
    )
    return Scale(float(f"{needed:.3g}"), reason)


def times(topo: Topo) -> Iterator[tuple[str, float]]:
    """Yield T1 and T2 of the memories and the delays of the fibres, each with its name."""
    for host in topo.hosts():
        info = topo.nodeInfo(host)
        if issubclass(info.get("cls") or object, QuantumHost):
            device = device_of(host, info)
            yield f"T1 of {host}", device.memory.t1_s
            yield f"T2 of {host}", device.memory.t2_s
    for one, other, info in topo.links(withInfo=True):
        if info.get("cls") is FiberLink:
            given = {name: value for name, value in info.items() if name in OPTICS}
            delay_s = optics(f"fibre {one} to {other}", **given).delay_s
            if delay_s:
                yield f"the fibre from {one} to {other}", delay_s
