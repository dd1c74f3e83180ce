"""What tcpdump says of itself at its end."""

from topologies.network import packets_missed


def test_packets_that_the_kernel_dropped_are_counted() -> None:
    words = "4007 packets captured\n4008 packets received by filter\n{} dropped by kernel\n"
    assert packets_missed(words.format("0 packets")) == 0
    assert packets_missed(words.format("1 packet")) == 1
    assert packets_missed(words.format("1436 packets")) == 1436
    assert packets_missed("tcpdump: listening on lo") == 0
