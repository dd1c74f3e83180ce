"""Times of links in SeQUeNCe for sequence_links.json, in an environment of its own (README.md)."""

import json
from importlib.metadata import version

from sequence.components.optical_channel import ClassicalChannel, QuantumChannel
from sequence.entanglement_management.generation import EntanglementGenerationA
from sequence.kernel.timeline import Timeline
from sequence.topology.node import BSMNode, QuantumRouter

M_PER_PS, GIVEN = 2.04e-4, {"db_per_km": 0.2, "emitted": 0.6, "detected": 0.9}
MEMORY = {"MemoryArray": {"fidelity": 1.0, "frequency": 0, "efficiency": GIVEN["emitted"]}}
STATION = {"SingleAtomBSM": {"detectors": [{"efficiency": GIVEN["detected"]}] * 2}}


def link(half_km: float, pairs: int) -> tuple[int, int, float]:
    """Return pairs, attempts and seconds of two hosts; the station is halfway."""
    timeline, metres = Timeline(), half_km * 1e3
    hosts = [QuantumRouter(name, timeline, 1, n, MEMORY) for n, name in enumerate(("alice", "bob"))]
    nodes = [*hosts, BSMNode("station", timeline, ["alice", "bob"], 2, STATION)]
    for one, other in [(a, b) for a in nodes for b in nodes if a is not b]:
        length, name = metres * (1 if nodes[2] in (one, other) else 2), f"{one.name}-{other.name}"
        ClassicalChannel(name, timeline, length, round(length / M_PER_PS)).set_ends(one, other.name)
    ended: list[str] = []
    for host in hosts:
        name, db_per_m = f"{host.name} fibre", GIVEN["db_per_km"] / 1e3
        fiber = QuantumChannel(name, timeline, db_per_m, metres, light_speed=M_PER_PS)
        fiber.set_ends(host, "station")
        host.resource_manager.update = lambda _protocol, _memory, state: ended.append(state)
    timeline.init()
    attempts = pairs_made = 0
    while pairs_made < pairs:
        attempts += 1
        for host, other in (hosts, hosts[::-1]):
            memory, theirs = (each.components[each.memo_arr_name][0] for each in (host, other))
            create = EntanglementGenerationA.create  # Barrett and Kok's
            host.protocols = [create(host, host.name, "station", other.name, memory)]
            host.protocols[0].set_others(other.name, other.name, [theirs.name])
        for host in hosts:
            host.protocols[0].start()
        timeline.run()
        pairs_made += ended == ["ENTANGLED", "ENTANGLED"]
        ended.clear()
    return pairs_made, attempts, timeline.now() / 1e12


if __name__ == "__main__":
    links = {half_km: link(half_km, 2000) for half_km in (1, 10, 25)}
    report = {"program": f"sequence {version('sequence')}", **GIVEN, "links": links}
    print(json.dumps(report, indent=1))
