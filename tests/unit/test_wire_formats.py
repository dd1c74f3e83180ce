"""Every format of bytes, cut at each place and with foreign bytes behind it."""

import pytest
from decoders import FORMATS

# A beginning of these is one, too: a stream, a list, or text; others refuse each beginning.
BEGINNINGS = {
    *("conference proposal", "path optics", "event", "event, shown", "record", "packed folder"),
    *("line of an application", "pcapng", "pcap", "key distribution, cut", "query for keys"),
    *("request for keys", "socket call", "socket call's fields", "console's answer"),
    *("NetQASM, application", "NetQASM, subroutine", "NetQASM, text", "optical port statistics"),
    "gaps",
}
# Behind these is the next message, padding of Ethernet, or free text.
TAILS = {
    *("conference proposal", "LLDP", "segment", "segment, rewritten", "datagram", "machine"),
    *("line of an application", "pcapng", "pcap", "frame", "socket call", "NetQASM, text"),
    *("optical port description", "optical PORT_MOD", "optical port statistics"),
}
UNSEALED = {"device", "device, of another"}  # refused as they are: feeding seals them


@pytest.mark.parametrize("name", FORMATS)
def test_a_message_is_read_and_written_as_it_was(name: str) -> None:
    target = FORMATS[name]
    read = [target.take(sample) for sample in target.samples if name != "console's answer"]
    assert all(read) is (name not in UNSEALED)


@pytest.mark.parametrize("name", FORMATS)
def test_a_message_that_is_cut_anywhere_is_refused(name: str) -> None:
    target = FORMATS[name]
    taken = [
        (sample.hex(), length)
        for sample in target.samples
        for length in range(len(sample))
        if target.take(sample[:length])
    ]
    assert bool(taken) is (name in BEGINNINGS), taken


@pytest.mark.parametrize("name", FORMATS)
def test_foreign_bytes_behind_a_message_are_refused(name: str) -> None:
    target = FORMATS[name]
    taken = [
        sample.hex()
        for sample in target.samples
        for behind in (b"\0", b"\xff")
        if target.take(sample + behind)
    ]
    assert bool(taken) is (name in TAILS), taken
