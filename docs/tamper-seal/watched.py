"""Idle fibres as sensors: seals watch two ways, and the controller closes the one that is tapped.

    alice --- q1 ====== q2 === charlie    alice watches her way to charlie, charlie his to bob;
              ||        ||                messages from alice to bob go by both, and come first
              q5 == q4 == q3 === bob

qmn script docs/tamper-seal/watched.py
"""

import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from hosts.service_socket import ServiceSocket
from hosts.stack_socket import QuantumSocketError
from qmn.changes.fibers import adjust
from qmn.running.network import dispatcher_of_running_network
from qmn.scripting import QuantumNetwork, start
from wire.controller_lines import read_record
from wire.dispatcher_pb2 import AdjustFiberRequest
from wire.metadata.vocabulary import Reason

POLICY = 'default = "allow"\n[seal]\nalarm = "close"\n'
WAYS = ("alice", "charlie"), ("charlie", "bob")
PORT, PAIRS, PAUSE_S, LONGEST_S = 20, 2000, 0.2, 60.0
TAPPED, MESSAGE = 0.5, bytes(200_000)
BEGUN = time.monotonic()


def say(text: str) -> None:
    """Print what happens, and when."""
    print(f"{time.monotonic() - BEGUN:6.2f} s  {text}", flush=True)


def take_part(listener: ServiceSocket) -> None:
    """Be the other end of a seal."""
    connection, _peer = listener.accept()
    with connection:
        while not connection.over:
            list(connection.results())


def watch(network: QuantumNetwork, opener: str, acceptor: str) -> str:
    """Watch a way for a moment, by pairs that the opener makes; return what is found."""
    mine, theirs = (network.runtime.socket(host) for host in (opener, acceptor))
    with (
        ThreadPoolExecutor(1) as pool,
        ServiceSocket(mine) as asking,
        ServiceSocket(theirs) as listener,
    ):
        listener.listen(PORT, "seal")
        other = pool.submit(take_part, listener)
        try:
            list(asking.request("seal", (acceptor, PORT), source=opener, count=PAIRS))
            asking.shutdown()
        except QuantumSocketError as error:
            if error.reason != Reason.BUSY:
                raise
            listener.close()  # nobody asks
            other.exception(LONGEST_S)
            say(f"{opener} to {acceptor}: at work")
            return "at work"
        other.result(LONGEST_S)
    found = asking.summary
    if found["preempted"]:
        say(f"{opener} to {acceptor}: light given back to a session")
        return "at work"
    verdict = "ALARM" if found["alarm"] else "whole"
    visibility = 1 - 2 * found["error_rate"]
    say(f"{opener} to {acceptor}: {verdict}, {found['compared']} pairs, {visibility:.2f} visible")
    return verdict


def closed(network: QuantumNetwork) -> list[str]:
    """Wait until the controller has heard of the alarm; return the fibres that it has closed."""
    while not (alarms := [f for f in read_record(network.runtime.logs) if f["event"] == "alarm"]):
        if time.monotonic() - BEGUN > LONGEST_S:
            raise TimeoutError(f"the controller has not heard of the alarm in {LONGEST_S:g} s")
        time.sleep(PAUSE_S)
    return [str(way) for fact in alarms if fact["closed"] for way in fact["watched"]]


def tap(one: str, other: str) -> None:
    """Put somebody on the fibres between two switches."""
    request = AdjustFiberRequest(a=one, b=other, tapped=TAPPED)
    adjust(dispatcher_of_running_network(), request)
    say(f"somebody measures {TAPPED:g} of the photons between {one} and {other}")


def main(policy: Path) -> None:
    """Watch; send a message; have a fibre tapped, and send another message round it."""
    with start("ring", switches=5, policy=str(policy)) as network, ThreadPoolExecutor(1) as pool:
        sending, tapped = pool.submit(network.send, "alice", "bob", MESSAGE), False
        while "ALARM" not in (found := {ends: watch(network, *ends) for ends in WAYS}).values():
            if time.monotonic() - BEGUN > LONGEST_S:
                raise TimeoutError(f"no alarm in {LONGEST_S:g} s")
            if sending.done() and not tapped and set(found.values()) == {"whole"}:
                say(f"message arrived: {sending.result().data == MESSAGE}")
                tap("q2", "q3")
                tapped = True
            time.sleep(PAUSE_S)
        say("closed: " + " ".join(closed(network)))
        result = network.send("alice", "bob", MESSAGE)
        say(f"message arrived: {result.data == MESSAGE}, errors {result.symbol_error_rate:g}")
        for path in network.trace("alice", "bob"):
            say("now by " + " ".join(hop.what for hop in path.hops if hop.what != "fibre"))


with tempfile.TemporaryDirectory() as folder:
    file = Path(folder) / "policy.toml"
    file.write_text(POLICY)
    main(file)
