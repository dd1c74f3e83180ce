"""Device messages and their envelope."""

import random
from dataclasses import replace
from math import inf, nan

import pytest

from applications.keys.route_messages import (
    MAX_HOPS,
    MAX_LINKS,
    Hop,
    KeyLinks,
    KeyRoute,
    KeyRouteRequest,
    LinkState,
    route_tag,
)
from wire.device import (
    MAX_PORTS,
    Datagram,
    DevicePort,
    DeviceQuery,
    DeviceReport,
    DeviceSettings,
    SessionQuery,
    SetDevice,
    Subscribe,
    open_sealed,
    setting_name,
    setting_number,
)
from wire.malformed import MalformedPacket
from wire.metadata.header import HEADER, Message
from wire.metadata.setup import Answer, Setup
from wire.metadata.vocabulary import Reason
from wire.monitor_messages import MonitorCommand, PreemptMonitor, Quantity, SessionEstimate

KEY, OTHER_KEY = "00112233445566778899aabbccddeeff", "ff" * 16
HOST, CONTROLLER = Datagram.FROM_HOST, Datagram.FROM_CONTROLLER
REPORT = DeviceReport(
    5,
    1,
    2,
    3,
    1000,
    2000,
    3000,
    40,
    50,
    60,
    50_000_000,
    256,
    3,
    1,
    1_550_120,
    1000,
    10_000,
    20_000,
    7,
    8,
    2027,
    13,
    10,
    3,
    DeviceSettings(rate_hz=1_000_000, fec=0),
    (DevicePort("bob-q0", True), DevicePort("bob-q1", False)),
)
GOLDEN = {
    DeviceQuery(1): "514d 05 20 00000010 0000000000000001",
    Subscribe(2, 1000, 10_000, 0): "514d 05 21 0000001c 0000000000000002000003e8 00002710 00000000",
    SetDevice(3, DeviceSettings(1_000_000, None, 3, 0, 1_551_720, 5000, 60)): "514d 05 22 0000002c"
    "0000000000000003 000f4240 ffffffff 00000003 00000000 0017ad68 00001388 0000003c",
    KeyLinks(6, (LinkState("10.0.0.2", 128, 64, 256, 50_000, 12_000, True),)): "514d 05 25 00000029"
    "0000000000000006 0a000002 00000080 00000040 00000100 0000c350 00002ee0 01",
    KeyRouteRequest(7, "10.0.0.3", 3, "sae-alice", "web"): "514d 05 26 00000098 0000000000000007"
    "0a000003 00000003" + "7361652d616c696365" + "00" * 55 + "776562" + "00" * 61,
    KeyRoute(8, 1, 5, (Hop("10.0.0.1"), Hop("10.0.0.9", b"\x07" * 16))): "514d 05 27 00000044"
    "0000000000000008 0000000000000001 00000005 0a000001" + "00" * 16 + "0a000009" + "07" * 16,
    MonitorCommand(10, 7, "10.0.0.1", "10.0.0.2", 2000, 1024, 100_000, 0.5, 0.25, 0.125, 0.0625): (
        "514d 05 28 0000004c 000000000000000a 0000000000000007 0a000001 0a000002"
        "000007d0 00000400 000186a0"
        "3fe0000000000000 3fd0000000000000 3fc0000000000000 3fb0000000000000"
    ),
    SessionQuery(12, 7): "514d 05 2a 00000018 000000000000000c 0000000000000007",
    SessionEstimate(0, 7, Quantity.CHSH, 2.5, 2.25, 2.75): "514d 05 2b 00000031 0000000000000000"
    "0000000000000007 03 4004000000000000 4002000000000000 4006000000000000",
    PreemptMonitor(11, 7): "514d 05 29 00000018 000000000000000b 0000000000000007",
    REPORT: "514d 05 23 000000bf 0000000000000005 0001 0002 0003"
    "00000000000003e8 00000000000007d0 0000000000000bb8"
    "0000000000000028 0000000000000032 000000000000003c"
    "02faf080 00000100 00000003 00000001 0017a728 000003e8 00002710 00004e20"
    "0000000000000007 0000000000000008 000007eb 0000000d 0000000a 03"
    "000f4240 ffffffff 00000000 ffffffff ffffffff ffffffff ffffffff"
    "626f622d7130000000000000000000 01 626f622d7131000000000000000000 00",
}


def opened(message: Message) -> Message:
    """Return what becomes of a message on its way."""
    return open_sealed(Datagram(message, "bob", 9).seal(KEY, HOST), KEY, HOST).message


@pytest.mark.parametrize("message", GOLDEN, ids=lambda message: type(message).__name__)
def test_bytes_are_golden_both_ways(message: Message) -> None:
    assert message.encode() == bytes.fromhex(GOLDEN[message])
    assert opened(message) == message


def test_the_envelope_is_golden() -> None:
    # The HMAC was computed by openssl over "controller" and what is before it.
    sealed = Datagram(DeviceQuery(1), "bob", 0x0102030405060708).seal(KEY, CONTROLLER)
    assert sealed == bytes.fromhex(
        GOLDEN[DeviceQuery(1)] + "626f62" + "00" * 29 + "0102030405060708"
        "73e5621060fc8b93b06336cbdd3bb718"
    )
    datagram = open_sealed(sealed, KEY, CONTROLLER)
    assert datagram == Datagram(DeviceQuery(1), "bob", 0x0102030405060708)


def test_the_tag_of_a_route_is_golden() -> None:
    # By openssl over "key route", the time, and the addresses.
    assert route_tag(KEY, 0x0102030405060708, ("10.0.0.1", "10.0.0.9")) == bytes.fromhex(
        "0a55619c4e40628fb3cf3ab7a659bb10"
    )


def test_every_flipped_bit_is_malformed() -> None:
    sealed = Datagram(REPORT, "bob", 9).seal(KEY, HOST)
    for bit in range(8 * len(sealed)):
        changed = bytearray(sealed)
        changed[bit // 8] ^= 1 << bit % 8
        with pytest.raises(MalformedPacket):
            open_sealed(bytes(changed), KEY, HOST)


def test_another_key_and_the_other_direction_are_refused() -> None:
    sealed = Datagram(DeviceQuery(1), "bob", 9).seal(KEY, CONTROLLER)
    for key, speaker in ((OTHER_KEY, CONTROLLER), (KEY, HOST)):
        with pytest.raises(MalformedPacket, match="HMAC is wrong"):
            open_sealed(sealed, key, speaker)


@pytest.mark.parametrize(
    "message",
    [
        SetDevice(1, DeviceSettings(rate_hz=0)),
        SetDevice(1, DeviceSettings(frame_bytes=65_537)),
        SetDevice(1, DeviceSettings(fec=256)),
        SetDevice(1, DeviceSettings(interleave=2)),
        SetDevice(1, DeviceSettings(wavelength_pm=10)),
        MonitorCommand(1, 7, "10.0.0.1", "10.0.0.1", 1, 1, 1, 0.1, 0.1, 0.1, 0.1),
        MonitorCommand(1, 7, "10.0.0.1", "10.0.0.2", 1, 1, 1, 0.1, 0.1, nan, 0.1),
        MonitorCommand(1, 7, "10.0.0.1", "10.0.0.2", 1, 1, 1, 0.1, 0.1, 0.1, -inf),
        SessionEstimate(0, 7, 0, 0.5, 0.4, 0.6),
        SessionEstimate(0, 7, 5, 0.5, 0.4, 0.6),
        SessionEstimate(0, 7, Quantity.QBER, nan, 0.4, 0.6),
        SessionEstimate(0, 7, Quantity.QBER, 0.5, nan, 0.6),
        SessionEstimate(0, 7, Quantity.QBER, 0.5, 0.4, inf),
        SessionEstimate(0, 7, Quantity.FIDELITY, 0.5, 0.6, 0.7),
        SessionEstimate(0, 7, Quantity.CHSH, 4.5, 4.4, 4.6),
        replace(REPORT, ports=(DevicePort("q", True),) * (MAX_PORTS + 1)),
        replace(REPORT, monitor_end=200),
        replace(REPORT, ports=(DevicePort("", True),)),
        replace(REPORT, ports=(DevicePort("\n", True),)),
        KeyLinks(1, (LinkState("10.0.0.2", 0, 0, 1, 0),) * (MAX_LINKS + 1)),
        KeyRouteRequest(1, "10.0.0.2", 1, "", "b"),
        KeyRouteRequest(1, "10.0.0.2", 1, "a", "\n"),
        KeyRoute(1, 1, 1, (Hop("10.0.0.1"),)),
        KeyRoute(1, 1, 1, (Hop("10.0.0.1"),) * (MAX_HOPS + 1)),
        Setup(1, 1, 1, "10.0.0.3", 1, 1, 1),
    ],
)
def test_what_a_speaker_with_the_key_may_not_say_is_malformed_too(message: Message) -> None:
    with pytest.raises(MalformedPacket):
        opened(message)


def test_every_body_of_random_bytes_is_malformed_or_means_what_it_says() -> None:
    generator, read = random.Random(5), 0
    for _ in range(2000):
        data = bytearray(generator.choice([REPORT.encode(), Answer(1, Reason.OK, "x").encode()]))
        for _ in range(generator.choice((1, 1, 4))):
            data[generator.randrange(len(data))] = generator.randrange(256)

        class Raw(DeviceQuery):
            def encode(self, data: bytes = bytes(data)) -> bytes:
                return data

        try:
            message = opened(Raw(0))
        except MalformedPacket:
            continue
        read += 1
        again = message.encode()
        assert len(again) == len(data)
        assert opened(message) == message
        # All but what stands behind a port's name, and how a yes is written.
        report = isinstance(message, DeviceReport)
        ports = HEADER.size + DeviceReport.FIELDS.size if report else len(data)
        assert again[:ports] == data[:ports]
    assert 500 < read < 1900


@pytest.mark.parametrize(
    ("name", "given", "number", "shown"),
    [
        ("fec", "golay", 3, "golay"),
        ("fec", 4, 4, "reed-solomon"),
        ("fec", 77, 77, 77),
        ("interleave", True, 1, "on"),
        ("interleave", "off", 0, "off"),
        ("rate_hz", 5, 5, 5),
    ],
)
def test_settings_have_names(name: str, given: object, number: int, shown: object) -> None:
    assert setting_number(name, given) == number
    assert setting_name(name, number) == shown


@pytest.mark.parametrize(
    ("name", "given", "words"),
    [
        ("fec", "turbo", "fec is 'turbo': give one of none, repetition, hamming, golay"),
        ("fec", True, "fec is True"),
        ("interleave", "yes", "give one of off, on"),
        ("rate_hz", 0.5, "rate_hz is 0.5: give a whole number"),
        ("rate_hz", "golay", "rate_hz is 'golay'"),
    ],
)
def test_a_setting_that_is_neither_name_nor_number_is_refused(
    name: str, given: object, words: str
) -> None:
    with pytest.raises(ValueError, match=words):
        setting_number(name, given)
