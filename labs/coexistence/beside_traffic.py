"""States are teleported while iperf sends on the copper beside the fibre that carries its light."""

import json
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

from coexistence import TRAFFIC_DBM, settings

from evidence.networks.point_network import session
from qmn.results.run_folder import make_folder
from qmn.scripting import start
from wire.results.run_result import RESULT

folder, words = make_folder(Path(sys.argv[4]), "sdc"), settings("o-band", TRAFFIC_DBM)
fiber, device = (
    [value for option, value in zip(words[::2], words[1::2], strict=True) if option == kind]
    for kind in ("--fiber", "--device")
)
with start("sdc", folder, seed=int(sys.argv[2]), fiber=fiber, device=device) as network:
    ends = [network.host(name) for name in ("alice", "bob")]
    light = partial(session, count=12_000_000, block_pairs=262_144, state="0")
    with light(network, "teleport", ("alice", "bob")) as sent:
        received = ThreadPoolExecutor(1).submit(network.net.iperf, ends, fmt="m", seconds=10)
        sent.results()
        figures = {**sent.summary, "gbit_per_s": float(received.result()[0].split()[0]) / 1e3}
facts = json.loads((folder / RESULT).read_text())
(folder / RESULT).write_text(json.dumps({**facts, "found": figures}))
