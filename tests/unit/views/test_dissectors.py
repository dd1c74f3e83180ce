"""The Wireshark dissectors, run by tshark on what wire/ itself encodes, and on rubbish."""

import random
import struct
from dataclasses import astuple, fields
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from dissection import datagram, found, segment, shown, tshark
from dissector_scene import (
    DEVICES,
    EVENT,
    KEY,
    METADATA,
    SEED,
    SETUP,
    astuple_of,
    device_refused,
    event_refused,
    inside,
    mutated,
    plain,
    refused,
    sign,
    with_other_values,
)

from views.dissection.dissectors import lua
from views.dissection.layout import COUNTED, Layout, device_layouts, metadata_layouts
from wire import optical
from wire.analyser_frames import BROADCAST, AnalyserFrame, End
from wire.analyser_frames import Emission as InnerEmission
from wire.device import (
    DEVICE_PORT,
    Datagram,
    DeviceQuery,
    DeviceReport,
    DeviceSettings,
)
from wire.dispatcher_pb2 import Event
from wire.events import encode_record
from wire.metadata.blocks import Block, Emission, Emit, Emitted, Finish, Frame, Report
from wire.metadata.header import TO_SWITCHES, Message
from wire.metadata.setup import Answer
from wire.parameters.physics import BellAnalyser, Device, Emitter, Memory, PairSource
from wire.parameters.switch import inner_port as inner
from wire.part_descriptions import describe


def expected(message: Message, layout: Layout, prefix: str) -> dict[str, list[Any]]:
    """Return what tshark shall show of a message, from its attributes alone."""
    values: dict[str, list[Any]] = {f"{prefix}.session": [message.session]}
    tails = {tail.name: tail for tail in layout.tails}
    for item in fields(message)[1:]:
        value, name = getattr(message, item.name), f"{prefix}.{item.name}"
        if isinstance(value, DeviceSettings):
            given = {k: v for k, v in vars(value).items() if v is not None}
            values |= {f"{name}.{key}": [number] for key, number in given.items()}
        elif isinstance(value, tuple):
            if tails[item.name].kind == COUNTED:
                values[f"{name}_count"] = [len(value)]
            if value and isinstance(value[0], int):
                values[name] = list(value)
            for element in value if value and not isinstance(value[0], int) else ():
                for key, report in vars(element).items():
                    report = report.hex() if isinstance(report, bytes) else report
                    values.setdefault(f"{name}.{key}", []).append(report)
        elif isinstance(value, bytes):
            values[name] = [value.hex()] if value else []
        else:
            values[name] = [value] if value != "" else []
    return values


def check_all(
    folder: Path,
    messages: list[Message],
    frames: list[bytes],
    layouts: list[Layout],
    prefix: str,
) -> None:
    known = {layout.number: layout for layout in layouts}
    wanted = [expected(message, known[message.KIND], prefix) for message in messages]
    names = sorted({name for row in wanted for name in row})
    assert len(names) > 20
    for message, row, want in zip(messages, shown(folder, frames, names), wanted, strict=True):
        seen = {name: _read(values, want.get(name)) for name, values in row.items() if values}
        assert seen == {name: values for name, values in want.items() if values}, message


def _read(values: list[str], want: list[Any] | None) -> list[float | str]:
    text = want is not None and bool(want) and isinstance(want[0], str)
    return [value if text else plain(value) for value in values]


def test_every_field_of_every_metadata_message_is_shown(tmp_path: Path) -> None:
    assert {type(message) for message in METADATA} >= {
        kind for kind in Message.__subclasses__() if kind.__module__ == "wire.metadata"
    }
    frames = [segment(message.encode(), number) for number, message in enumerate(METADATA)]
    check_all(tmp_path, METADATA, frames, metadata_layouts(), "qmeta")


def test_every_field_of_every_device_message_is_shown(tmp_path: Path) -> None:
    frames = [
        datagram(Datagram(message, "alice", 99).seal(KEY, Datagram.FROM_HOST), DEVICE_PORT)
        for message in DEVICES
    ]
    check_all(tmp_path, DEVICES, frames, device_layouts(), "qdev")
    rows = shown(tmp_path, frames, ["qdev.host", "qdev.number", "qdev.malformed"])
    assert [astuple_of(row) for row in rows] == [("alice", "99", "")] * len(DEVICES)


def test_filters_take_the_names_of_numbers(tmp_path: Path) -> None:
    frames = [segment(message.encode(), number) for number, message in enumerate(METADATA)]
    wanted = {
        'qmeta.service == "SDC"': 1,
        'qmeta.verdict == "REFUSED"': 1,
        'qmeta.kind == "Report"': 2,
        "qmeta.session == 9": 1,
        "qmeta.refused": 2,
    }
    counts = found(tmp_path, frames, list(wanted))
    assert dict(zip(wanted, counts, strict=True)) == wanted


def test_messages_are_put_together_across_segments(tmp_path: Path) -> None:
    draw = random.Random(SEED)
    frames = tuple(Frame(number, 1, number) for number in range(4096))
    messages = [*METADATA, Block(77, 1, 4 * 4096, 0, 1, frames), *METADATA]
    stream = b"".join(message.encode() for message in messages)
    cuts = sorted({0, len(stream), *(draw.randrange(len(stream)) for _ in range(60))})
    segments = [segment(stream[start:end], seq=1 + start) for start, end in pairwise(cuts)]
    rows = shown(tmp_path, segments, ["qmeta.session", "qmeta.malformed", "qmeta.frames.crc32"])
    sessions = [plain(text) for row in rows for text in row["qmeta.session"]]
    assert sessions == [message.session for message in messages]
    assert not any(row["qmeta.malformed"] for row in rows)
    assert sum(len(row["qmeta.frames.crc32"]) for row in rows) == 4096 + 4


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("passes", [1, 2])
@pytest.mark.parametrize("most_bytes", [60, 96, 128, 150])
def test_what_a_capture_has_cut_is_not_malformed(
    tmp_path: Path, most_bytes: int, passes: int
) -> None:
    sealed = [Datagram(message, "alice", 9).seal(KEY, Datagram.FROM_HOST) for message in DEVICES]
    datagrams = [datagram(data, DEVICE_PORT) for data in sealed]
    stream = b"".join(message.encode() for message in METADATA) * 3
    ends = [*range(0, len(stream), 300), len(stream)]
    segments = [segment(stream[start:end], seq=1 + start) for start, end in pairwise(ends)]
    frames = [*datagrams, *segments]
    names = ["qdev.malformed", "qmeta.malformed", "_ws.malformed", "_ws.col.Info"]
    rows = shown(tmp_path, frames, names, passes=passes, most_bytes=most_bytes)
    assert not any(row[name] for row in rows for name in names[:3])
    whole = [frame for frame in datagrams if len(frame) <= most_bytes]
    cut = [row for row in rows[: len(datagrams)] if row[names[3]] == ["cut by the capture"]]
    assert len(cut) == len(datagrams) - len(whole)
    assert "cut by the capture" in "".join(rows[len(datagrams)][names[3]])


def test_a_cut_event_is_not_malformed(tmp_path: Path) -> None:
    record = encode_record(EVENT)
    rows = shown(tmp_path, [record], ["qevent.malformed"], interface=1, most_bytes=len(record) - 1)
    assert rows == [{"qevent.malformed": []}]


def test_requests_and_answers_are_linked(tmp_path: Path) -> None:
    ask = [SETUP, Emit(1, 2, 3, 4), Block(1, 5, 0, 0, 1), Block(1, 6, 0, 0, 1), Finish(1, 0, b"")]
    answers = [Answer(1, 0), Answer(1, 0), Report(1, 6, 0), Report(1, 5, 0), Answer(1, 0)]
    frames, places = [], [1, 1]
    for message, is_answer in [
        *((message, False) for message in ask[:1]),
        *((message, True) for message in answers[:1]),
        *((message, False) for message in ask[1:]),
        *((message, True) for message in answers[1:]),
    ]:
        data = message.encode()
        frames.append(segment(data, seq=places[is_answer], answer=is_answer))
        places[is_answer] += len(data)
    names = ["qmeta.request_in", "qmeta.response_in", "qmeta.response_ms"]
    rows = [astuple_of(row) for row in shown(tmp_path, frames, names)]
    assert [row[:2] for row in rows] == [
        ("", "2"),  # set-up
        ("1", ""),
        ("", "7"),  # emit
        ("", "9"),  # block 5
        ("", "8"),  # block 6
        ("", "10"),  # finish
        ("3", ""),
        ("5", ""),
        ("4", ""),
        ("6", ""),
    ]
    assert float(rows[6][2]) == pytest.approx(4.0)


def test_a_source_is_said_to_answer_a_question_alone(tmp_path: Path) -> None:
    messages = [Emission(1, 2, 3, 4), Emission(1, 3, 3, 4), Emitted(1, 3), Answer(1, 0)]
    frames, places = [], [1, 1]
    for message in messages:
        data, is_answer = message.encode(), isinstance(message, Answer)
        frames.append(segment(data, seq=places[is_answer], answer=is_answer))
        places[is_answer] += len(data)
    rows = shown(tmp_path, frames, ["qmeta.request_in", "qmeta.response_in"])
    assert [astuple_of(row) for row in rows] == [("", ""), ("", ""), ("", "4"), ("3", "")]


def test_device_requests_and_reports_are_linked(tmp_path: Path) -> None:
    frames = [
        datagram(Datagram(message, "alice", 1).seal(KEY, Datagram.FROM_HOST), DEVICE_PORT)
        for message in (DeviceQuery(5), DeviceReport(0), DeviceReport(5))
    ]
    rows = shown(tmp_path, frames, ["qdev.request_in", "qdev.response_in"])
    assert [astuple_of(row) for row in rows] == [("", "3"), ("", ""), ("1", "")]


def test_what_python_refuses_is_marked_as_malformed_and_nothing_else(tmp_path: Path) -> None:
    draw = random.Random(SEED)
    sources = [*METADATA, SETUP, SETUP, METADATA[4], METADATA[6]]
    mutants = [mutated(draw, draw.choice(sources).encode()) for _ in range(3000)]
    mutants += with_other_values(METADATA, metadata_layouts())
    frames = [segment(data, number) for number, data in enumerate(mutants)]
    rows = shown(tmp_path, frames, ["qmeta.malformed"], passes=1)
    wanted = [refused(data) for data in mutants]
    assert 0.2 < sum(wanted) / len(wanted) < 0.8
    wrong = [
        (data.hex(), want)
        for data, row, want in zip(mutants, rows, wanted, strict=True)
        if bool(row["qmeta.malformed"]) != want
    ]
    assert wrong == []


def test_device_datagrams_that_python_refuses_are_marked(tmp_path: Path) -> None:
    draw = random.Random(SEED)
    sealed = []
    for _ in range(1500):
        whole = Datagram(draw.choice(DEVICES), "alice", 9).seal(KEY, Datagram.FROM_HOST)
        data = sign(mutated(draw, whole[:-16]) if draw.random() < 0.5 else inside(draw, whole))
        sealed.append(data)
    trailer = Datagram(DEVICES[0], "alice", 9).seal(KEY, Datagram.FROM_HOST)[-56:-16]
    sealed += [sign(data + trailer) for data in with_other_values(DEVICES, device_layouts())]
    wanted = [device_refused(data) for data in sealed]
    frames = [datagram(data, DEVICE_PORT) for data in sealed]
    rows = shown(tmp_path, frames, ["qdev.malformed"], passes=1)
    assert 0.2 < sum(wanted) / len(wanted) < 0.8
    wrong = [
        (data.hex(), want)
        for data, row, want in zip(sealed, rows, wanted, strict=True)
        if bool(row["qdev.malformed"]) != want
    ]
    assert wrong == []


def test_every_field_of_an_event_is_shown(tmp_path: Path) -> None:
    values = {
        "qevent.time_ns": EVENT.time_ns,
        "qevent.node": EVENT.node,
        "qevent.kind": EVENT.kind,
        "qevent.session": EVENT.block.session,
        "qevent.block.number": 3,
        "qevent.block.half": 1,
        "qevent.port": EVENT.port,
        "qevent.photons": EVENT.photons,
        "qevent.lost": 7,
        "qevent.detail": EVENT.detail,
        "qevent.photon": EVENT.photon,
        "qevent.first": "Z 1",
    }
    every = {field.name for field in Event.DESCRIPTOR.fields}
    assert {name.split(".")[1] for name in values} >= every - {"block"}, "a new field: name it here"
    later = encode_record(EVENT) + b"\xa2\x06\x03new\xa8\x06\x05"  # fields 100 and 101
    rows = shown(tmp_path, [encode_record(EVENT), later], [*values, "qevent.unknown"], interface=1)
    assert [plain(rows[0][name][0]) for name in values] == list(values.values())
    assert [rows[1][name] for name in values] == [rows[0][name] for name in values]
    assert rows[0]["qevent.unknown"] == []
    assert len(rows[1]["qevent.unknown"]) == 2
    filtered = tshark(
        tmp_path, [encode_record(EVENT)], "-Y", "qevent.session == 0xfedcba9876543210", interface=1
    )
    assert len(filtered) == 1


def test_events_that_python_refuses_are_marked(tmp_path: Path) -> None:
    draw = random.Random(SEED)
    records = []
    for _ in range(2000):
        data = bytearray(encode_record(EVENT))
        for _change in range(draw.randrange(4)):
            data[draw.randrange(len(data))] = draw.randrange(256)
        records.append(bytes(data[: draw.randrange(1, len(data) + 1)]))
    rows = shown(tmp_path, records, ["qevent.malformed"], interface=1, passes=1)
    wrong = [
        data.hex()
        for data, row in zip(records, rows, strict=True)
        if bool(row["qevent.malformed"]) != event_refused(data)
    ]
    assert wrong == []


def openflow(kind: int, body: bytes) -> bytes:
    return struct.pack("!BBHI", 5, kind, 8 + len(body), 1) + body


def openflow_messages() -> list[tuple[str, bytes, list[Any]]]:
    """Return messages with optics: prefix of the fields, bytes, what they say."""
    description = optical.PortOptics(15, 2, 3, 4, 5, 6, 7, -200, 30)
    light = optical.PortLight(15, 1, -2, 3, 4, -5, 6, -7, -8, 9, -10)
    tuning = optical.PortTuning(15, 193_400_000, -1, 50_000, -30)
    paths = [optical.PathOptics(1, 2, 3000, 3, True), optical.PathOptics(4, 5, 6, 0)]
    port = struct.pack("!IH2x6s2x16sII", 7, 40 + len(description.encode()), b"", b"p", 0, 0)
    stats = struct.pack("!H2xIII8Q", 80 + len(light.encode()), 7, 0, 0, *range(8))
    mod = struct.pack("!I4x6s2xII", 7, b"", 0, 0)
    experimenter = struct.pack("!II", optical.EXPERIMENTER, optical.PATH_OPTICS)
    modify = openflow(16, mod + tuning.encode())
    return [
        ("description", reply(13, port + description.encode()), [description]),
        ("statistics", reply(4, stats + light.encode()), [light]),
        ("tuning", modify, [tuning]),
        ("tuning", openflow(34, struct.pack("!I2xH", 1, 0) + modify), [tuning]),
        ("description", openflow(12, b"\0" * 8 + port + description.encode()), [description]),
        ("path", reply(0xFFFF, experimenter + optical.encode_path_optics(paths)), paths),
    ]


def reply(part: int, body: bytes) -> bytes:
    return openflow(19, struct.pack("!HH4x", part, 0) + body)


def test_optics_in_openflow_are_shown(tmp_path: Path) -> None:
    messages = openflow_messages()
    frames = [
        segment(data, number, port=6653) for number, (_, data, _structures) in enumerate(messages)
    ]
    names = {
        f"qof.{prefix}.{item.name}"
        for prefix, _data, structures in messages
        for item in fields(structures[0])
    }
    ordered = sorted(names)
    for (prefix, _data, structures), row in zip(
        messages, shown(tmp_path, frames, ordered), strict=True
    ):
        want = {
            f"qof.{prefix}.{item.name}": [int(getattr(one, item.name)) for one in structures]
            for item in fields(structures[0])
        }
        seen = {name: [plain(text) for text in values] for name, values in row.items() if values}
        assert seen == want
        assert [astuple(one) for one in structures]


def inner_port(number: int, name: bytes, described: bytes) -> bytes:
    size = 40 + len(described)
    return struct.pack("!IH2x6s2x16sII", number, size, b"", name, 0, 0) + described


PARTS = Device(
    analyser=BellAnalyser("linear", visibility=0.95),
    memory=Memory(capacity=9, t1_s=1.0, t2_s=2.0, cutoff_s=0.5),
    source=PairSource(fidelity=0.97),
    emitter=Emitter("two-click", 0.5, modes=20),
)
SHOWN = {  # by what Wireshark shows of each of the switch's parts
    60_002: {"kind": 5, "which": 2, "optics": 2, "visibility": 950_000, "dark_counts": 0},
    61_001: {"kind": 2, "which": 0, "modes": 9, "t1_ns": 10**9, "cutoff_ns": 5 * 10**8},
    62_001: {"kind": 3, "which": 1, "statistics": 1, "phi_plus": 970_000, "psi_minus": 10_000},
    63_001: {"kind": 4, "scheme": 1, "modes": 20, "efficiency": 500_000, "fidelity": 1_000_000},
}


def statuses() -> list[bytes]:
    return [
        openflow(12, bytes(8) + inner_port(port, b"p", describe(inner(port), PARTS)))
        for port in SHOWN
    ]


def test_parts_behind_inner_ports_are_shown(tmp_path: Path) -> None:
    frames = [segment(data, at, port=6653) for at, data in enumerate(statuses())]
    names = sorted({f"qof.part.{name}" for values in SHOWN.values() for name in values})
    rows = shown(tmp_path, frames, ["qof.port", *names])
    for (port, values), row in zip(SHOWN.items(), rows, strict=True):
        assert row["qof.port"] == [str(port)]
        seen = {name: row[f"qof.part.{name}"] for name in values}
        assert seen == {name: [str(number)] for name, number in values.items()}


def test_spoiled_openflow_is_no_error_of_the_script(tmp_path: Path) -> None:
    draw = random.Random(SEED)
    frames, messages = [], [*(data for _, data, _ in openflow_messages()), *statuses()]
    for number in range(600):
        data = bytearray(draw.choice(messages))
        for _ in range(draw.randrange(5)):
            data[draw.randrange(8, len(data))] = draw.choice([0, 1, 8, 0x7F, 0xFF])
        data = data[: draw.randrange(8, len(data) + 1)]
        data[2:4] = len(data).to_bytes(2, "big")
        frames.append(segment(bytes(data), number, port=6653))
    assert len(shown(tmp_path, frames, ["frame.number"])) == 600


def test_a_first_byte_alone_is_waited_for(tmp_path: Path) -> None:
    data = SETUP.encode()
    frames = [segment(data[:1]), segment(data[1:], seq=2), segment(b"X", 1), segment(b"QX", 2)]
    rows = shown(tmp_path, frames, ["qmeta.kind", "qmeta.malformed"])
    assert [bool(row["qmeta.malformed"]) for row in rows] == [False, False, True, True]
    assert rows[1]["qmeta.kind"] == ["1"]


def test_copies_on_further_links_are_shown_too(tmp_path: Path) -> None:
    frames = [segment(SETUP.encode()), segment(SETUP.encode())]
    rows = shown(tmp_path, frames, ["qmeta.kind"])
    assert [row["qmeta.kind"] for row in rows] == [["1"], ["1"]]


def test_a_copy_for_quantum_switches_is_a_message_where_it_comes_alone(tmp_path: Path) -> None:
    message = segment(SETUP.encode())
    copy = TO_SWITCHES + message[6:]
    fields = ["qmeta.kind", "_ws.col.Info"]
    (alone,) = shown(tmp_path, [copy], fields)
    merged = shown(tmp_path, [message, copy, message], fields)
    assert alone["qmeta.kind"] == ["1"]
    assert [row["qmeta.kind"] for row in merged] == [["1"], [], ["1"]]
    assert merged[1]["_ws.col.Info"] == ["[TCP Retransmission] copy for quantum switches"]


def test_lua_text_cannot_end_its_quotes() -> None:
    assert lua({"a": [1, True, None, "b"]}) == '{["a"] = {1, true, nil, "b"}}'
    assert lua("a\\") == '"a\\\\"'
    for value in ('"', "\n", "ä", 1.5):
        with pytest.raises(TypeError):
            lua(value)


INNER = [
    f"qinner.{name}"
    for name in ("end", "port", "number", "pulses", "outcome", "session", "pairs", "malformed")
]
METHOD = "qinner.method"


def test_frames_of_inner_ports_show_their_fields(tmp_path: Path) -> None:
    report = AnalyserFrame(60_001, 7, End.MEASURED, 5, 0, bytes([0, 1, 2, 3, 255]))
    stored = AnalyserFrame(61_001, 8, End.STORED, 2, 0, bytes(2))
    emission = InnerEmission(9, 1, 100, 50_000_000, 193_400_000)
    rubbish = BROADCAST + bytes(6) + b"\x88\xb5" + bytes(46)
    turned = AnalyserFrame(61_001, 8, End.PURIFY, 2, 0, bytes([11, 255]), method=3)
    frames = [each.encode(BROADCAST, bytes(6)) for each in (report, stored)]
    frames += [emission.encode(), rubbish, turned.encode(BROADCAST, bytes(6))]
    rows = shown(tmp_path, frames, [*INNER, METHOD])
    reports = [[row[name] for name in INNER] for row in rows]
    assert reports[0] == [["0"], ["60001"], ["7"], ["5"], ["0", "1", "2", "3", "15"], [], [], []]
    assert reports[1] == [["5"], ["61001"], ["8"], ["2"], ["0", "0"], [], [], []]
    assert reports[2] == [[], [], ["1"], [], [], ["9"], ["100"], []]
    assert reports[3][:7] == [[]] * 7
    assert reports[3][7]  # malformed
    assert reports[4] == [["9"], ["61001"], ["8"], ["2"], ["11", "15"], [], [], []]
    assert rows[4][METHOD] == ["3"]
