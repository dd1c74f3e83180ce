"""A service: entangled pairs, measured at both ends, are coins that two hosts throw alike.

qmn script examples/coins.py

Pairs of fidelity F, which depolarising has made so, give equal outcomes with (2F + 1) / 3.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

from hosts.service_socket import ServiceSocket
from qmn.scripting import start

PORT, COINS = 9, 1000


def shown(outcomes: Sequence[int]) -> str:
    """Return the first as heads and tails."""
    return "".join("HT"[outcome] for outcome in outcomes[:40])


with (
    start("sdc", device=["charlie.source.fidelity=0.9"]) as network,
    ServiceSocket(network.runtime.socket("alice")) as alice,
    ServiceSocket(network.runtime.socket("bob")) as listener,
    ThreadPoolExecutor(1) as pool,
):
    listener.listen(PORT, "distribute")
    accepted = pool.submit(listener.accept)
    for progress in alice.request("distribute", ("bob", PORT), count=COINS):
        print(f"{progress['pairs']} pairs are in the memories of both")
    bob, _address = accepted.result(10)
    list(bob.results())  # until bob knows that all have come
    question = {"measure": list(range(COINS)), "basis": "Z"}
    hers, his = alice.ask(**question)["outcomes"], bob.ask(**question)["outcomes"]
    alice.shutdown()

print(f"alice  {shown(hers)}\nbob    {shown(his)}")
print(f"alike: {sum(one == other for one, other in zip(hers, his, strict=True))} of {COINS}")
