"""A script that cuts a fibre while a message is under way, and mends it again.

qmn script examples/fiber_cut.py
"""

import os
from concurrent.futures import ThreadPoolExecutor

from qmn.scripting import QuantumNetwork, start


def passed(network: QuantumNetwork) -> int:
    """Return how many photons have come out of the fibres between q1 and q2."""
    between = [fiber for fiber in network.fibers() if {fiber.a[:3], fiber.b[:3]} == {"q1:", "q2:"}]
    return sum((fiber.photons_to_a or 0) + (fiber.photons_to_b or 0) for fiber in between)


message = os.urandom(1_000_000)
with start("ring", switches=4) as network, ThreadPoolExecutor(1) as pool:
    sending = pool.submit(network.send, "alice", "bob", message)
    while not passed(network) and not sending.done():
        network.sleep(1e-5)
    print("before:", *(f"{path.hops[0].begin} to {path.hops[-1].end}" for path in network.paths()))
    network.net.configLinkStatus("q1", "q2", "down")
    result = sending.result(90)
    print(f"{len(result.data):,} bytes arrived, exactly: {result.data == message}")
    print(f"{result.lost_pairs:,} pairs lost, of {result.bell_pairs:,}")
    for path in network.trace("alice", "bob"):
        print("now by", *(hop.what for hop in path.hops if hop.what != "fibre"))
