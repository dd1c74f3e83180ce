"""Time in a result: its scale, and how much of it was software."""

from collections.abc import Iterable
from math import inf

from qmn.results.schema import RunFacts
from wire.dispatcher_pb2 import SoftwareTime
from wire.parameters.physics import Device, Memory

DOMINATED = 0.5  # of a wait
MATTERS = 0.01  # of the shortest T1 or T2


def note_software(facts: RunFacts, software: SoftwareTime, devices: Iterable[Device]) -> None:
    """Add how much was software; None where no qubit waited in a memory."""
    waited = software.largest_wait_share > 0 or software.longest_ns > 0
    longest_s = software.longest_ns / 1e9
    shortest_s = min((coherence_s(device.memory) for device in devices), default=inf)
    facts["software_share"] = software.largest_wait_share if waited else None
    facts["software_s"] = longest_s if waited else None
    facts["software_share_of_run"] = software.run_share
    decayed = software.largest_decaying_share > DOMINATED
    facts["dominated_by_software"] = decayed and longest_s > MATTERS * shortest_s


def coherence_s(memory: Memory) -> float:
    """Return the shortest time in which waiting does something, T1 and T2 among others."""
    return memory.shortest_s


def rows(facts: RunFacts) -> dict[str, str]:
    """Return what is said of time, for a person to read."""
    scale = facts["time_scale"]
    told = {"time": f"1 s of the network took {scale:g} s here"}
    share = facts.get("software_share")
    if share is not None:
        told["software"] = f"up to {share:.1%} of a wait in memory, {facts['software_s']:.3g} s"
    early = facts.get("acausal")
    if early is not None:
        told["ACAUSAL"] = (
            f"news of {early['from']} can be at {early['to']} {early['early_s']:.3g} s before light"
        )
    if facts.get("dominated_by_software"):
        told["BEWARE"] = (
            "waits were dominated by software: what they did to qubits is this machine's doing; "
            "use --time-scale auto"
        )
    return told
