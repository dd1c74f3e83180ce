"""Sessions that cannot be or that break, and a second network: refused, and the first goes on."""

from threading import Timer

import pytest
from conftest import wait_until

from hosts.quantum_socket import QuantumSocket, QuantumSocketError
from topologies.networks.network import Network
from wire.metadata.vocabulary import Reason


def test_no_listener_is_a_refusal_with_a_reason(shared_network: Network) -> None:
    with (
        QuantumSocket(shared_network.runtime.socket("alice")) as sender,
        pytest.raises(QuantumSocketError, match="no application listens on port 9") as caught,
    ):
        sender.connect(("bob", 9))
    assert caught.value.reason == Reason.NO_LISTENER


def test_a_second_session_over_the_same_fibres_is_refused_as_busy(shared_network: Network) -> None:
    alice = shared_network.runtime.socket("alice")
    with QuantumSocket(shared_network.runtime.socket("bob")) as listener:
        listener.listen(7)
        with QuantumSocket(alice) as first, QuantumSocket(alice) as second:
            first.connect(("bob", 7))
            with pytest.raises(QuantumSocketError, match="another session uses") as caught:
                second.connect(("bob", 7))
    assert caught.value.reason == Reason.BUSY


def test_a_sender_that_vanishes_leaves_the_receiver_with_an_error(shared_network: Network) -> None:
    with QuantumSocket(shared_network.runtime.socket("bob")) as listener:
        listener.listen(7)
        sender = QuantumSocket(shared_network.runtime.socket("alice"))
        sender.connect(("bob", 7))
        receiver, _peer = listener.accept()
        sender.sendall(b"half a mess")
        sender.close()
        with receiver:
            assert receiver.recv(100) == b"half a mess"
            with pytest.raises(QuantumSocketError, match="mid-session"):
                receiver.recv(100)


def test_the_network_still_works_after_a_session_that_broke(shared_network: Network) -> None:
    with QuantumSocket(shared_network.runtime.socket("bob")) as listener:
        listener.listen(7)
        broken = QuantumSocket(shared_network.runtime.socket("alice"))
        broken.connect(("bob", 7))
        broken.close()
        listener.accept()[0].close()

        def again() -> bool:
            with QuantumSocket(shared_network.runtime.socket("alice")) as sender:
                try:
                    sender.connect(("bob", 7))
                except QuantumSocketError as error:
                    if error.reason != Reason.BUSY:
                        raise
                    return False
                receiver, _peer = listener.accept()
                with receiver:
                    sender.sendall(b"again")
                    return receiver.recv(100) == b"again"

        wait_until(again, "the fibres are free again and carry bytes")


def test_a_host_whose_address_is_told_late_is_reached(shared_network: Network) -> None:
    """The kernel asks three times, a second apart, and says then that there is no way there."""
    alice, bob = (shared_network.net.get(name) for name in ("alice", "bob"))
    link = f"ip link set {bob.defaultIntf()} arp"
    bob.cmd(f"{link} off")
    for host in (alice, bob):
        host.cmd("ip neigh flush all")
    report = Timer(3.5, lambda: bob.cmd(f"{link} on"))
    with QuantumSocket(shared_network.runtime.socket("bob")) as listener:
        listener.listen(7)
        report.start()
        with QuantumSocket(shared_network.runtime.socket("alice")) as sender:
            sender.connect(("bob", 7))
            sender.close()
        listener.accept()[0].close()
    report.join()
