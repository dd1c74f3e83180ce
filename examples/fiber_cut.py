"""A script that cuts a fibre while a message is under way, and mends it again.

qmn script examples/fiber_cut.py
"""

import os
from concurrent.futures import ThreadPoolExecutor

from qmn.scripting import start

message = os.urandom(200_000)
with start("ring", switches=4) as network, ThreadPoolExecutor(1) as pool:
    before = network.trace("alice", "bob")
    sending = pool.submit(network.send, "alice", "bob", message)
    while not network.paths():
        pass  # until the light path stands
    network.net.configLinkStatus("q1", "q2", "down")
    result = sending.result(60)
    after = network.trace("alice", "bob")
    network.net.configLinkStatus("q1", "q2", "up")

for when, paths in (("before", before), ("after", after)):
    for path in paths:
        print(when, " ".join(hop.what for hop in path.hops if hop.what != "fibre"))
print(f"{len(result.data):,} bytes arrived, exactly: {result.data == message}")
print(f"lost pairs: {result.lost_pairs > 0}")
