"""Sessions between whole stacks over loopback, with a real dispatcher."""

import asyncio
import socket
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import grpc
import numpy as np
import pytest
from limits import SOON_S
from stacks_scene import OWN_ADDRESS, PORTS, QNICS, Judge, grant, network, transfer

from hosts import network_loop
from hosts.hardware import pair_light
from hosts.hardware.block_name import BlockName
from hosts.hardware.simulated import SimulatedQnic
from hosts.hardware.steps import Pulses
from hosts.middleware.services.superdense import opener, sender
from hosts.middleware.services.superdense.coding import CODES, NAMES
from hosts.middleware.services.superdense.frame_format import FrameFormat
from hosts.middleware.session import encoding
from hosts.quantum_socket import QuantumSocket, QuantumSocketError
from wire import dispatcher_service
from wire.device import DeviceSettings
from wire.dispatcher_pb2 import SwitchStatisticsRequest
from wire.dispatcher_pb2_grpc import DispatcherStub
from wire.metadata.decoding import decode
from wire.metadata.header import METADATA_PORT
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Fec, Reason, Service, Verdict
from wire.outcomes import Pauli
from wire.socket_calls import HEADER as CALL_HEADER
from wire.socket_calls import Call, decode_fields, decode_header, encode


def exchange(
    folder: Path,
    data: bytes,
    judge: Judge = grant,
    physics: dict[str, Any] | None = None,
    **options: Any,
) -> tuple[bytes, dict[str, Any]]:
    """Run the network for one transfer."""

    async def run() -> tuple[bytes, dict[str, Any]]:
        async with network(folder, judge, **(physics or {})):
            return await asyncio.to_thread(transfer, folder, data, **options)

    return network_loop.run(run())


@pytest.mark.parametrize("handshake", ["framed", "per-pair", "sequential"])
def test_bytes_arrive_as_they_were_sent(tmp_path: Path, handshake: str) -> None:
    data = bytes(range(244, 256))
    got, statistics = exchange(tmp_path, data, handshake=handshake)
    assert got == data
    assert statistics["bell_pairs"] == 4 * len(data)
    assert statistics["lost_pairs"] == statistics["repeated_frames"] == 0


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("handshake", ["framed", "per-pair"])
@pytest.mark.parametrize("rotation", [Pauli.X, Pauli.Z, Pauli.XZ])
def test_a_wrong_rotation_in_the_verdict_breaks_every_frame(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, handshake: str, rotation: Pauli
) -> None:
    monkeypatch.setattr(sender, "ATTEMPTS_LIMIT", 8)

    def rotated(setup: Setup) -> Setup:
        return replace(setup, verdict=Verdict.GRANTED, rotation=rotation)

    with pytest.raises(QuantumSocketError, match="failed its check 8 times") as caught:
        exchange(tmp_path, b"x", rotated, handshake=handshake, frame_bytes=1)
    assert caught.value.reason == Reason.TOO_NOISY


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("handshake", ["framed", "per-pair"])
@pytest.mark.parametrize("rotation", [Pauli.X, Pauli.Z, Pauli.XZ])
def test_the_known_rotation_of_the_switch_is_undone(
    tmp_path: Path, handshake: str, rotation: Pauli
) -> None:
    def announced(setup: Setup) -> Setup:
        return replace(setup, verdict=Verdict.GRANTED, rotation=rotation)

    fiber = {"rotation": rotation}
    got, statistics = exchange(tmp_path, b"turned", announced, fiber, handshake=handshake)
    assert got == b"turned"
    assert statistics["repeated_frames"] == 0


@pytest.mark.parametrize("handshake", ["framed", "per-pair"])
def test_losses_and_errors_are_repaired(tmp_path: Path, handshake: str) -> None:
    fiber = {"length_km": 1.0, "loss_db_per_km": 0.2, "depolarizing": 0.01}
    got, statistics = exchange(
        tmp_path, b"twelve bytes", physics=fiber, handshake=handshake, frame_bytes=4
    )
    assert got == b"twelve bytes"
    assert statistics["lost_pairs"] > 0


FECS = ["repetition", "hamming", "golay", "reed-solomon"]
# A pair crosses six fibres: 3.4 % of the pairs are lost, 1.3 % of the symbols are wrong.
NOISY = {"length_km": 1.0, "loss_db_per_km": 0.025, "depolarizing": 0.003}
# With three symbols one lost or wrong symbol takes eleven bits with it.
LESS_NOISY = {"length_km": 1.0, "loss_db_per_km": 0.005, "depolarizing": 0.001}


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("fec", FECS)
@pytest.mark.parametrize("interleave", [False, True])
def test_every_code_delivers_exactly_over_fibres_that_lose_and_depolarise(
    tmp_path: Path, fec: str, interleave: bool
) -> None:
    data = bytes(range(256)) * 3
    got, statistics = exchange(
        tmp_path, data, physics=NOISY, fec=fec, interleave=interleave, frame_bytes=24
    )
    assert got == data
    assert statistics["lost_pairs"] > 0
    assert statistics["corrected_symbols"] > 0
    assert statistics["filled_symbols"] > 0
    assert statistics["interleave"] == interleave


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("fec", FECS)
def test_every_code_delivers_exactly_pair_by_pair(tmp_path: Path, fec: str) -> None:
    data = b"four"
    got, statistics = exchange(
        tmp_path, data, physics=NOISY, handshake="per-pair", fec=fec, interleave=True
    )
    assert got == data
    code = CODES[NAMES[fec]]
    assert statistics["bell_pairs"] >= FrameFormat(code).pairs(len(data))
    assert statistics["code_rate"] == 32 / code.encoded_bits(32)


def test_the_controller_overrides_code_and_interleaving(tmp_path: Path) -> None:
    data = bytes(range(240))  # 160 codewords of 12 bits
    physics = {"settings": DeviceSettings(fec=Fec.GOLAY, interleave=1)}
    asked: list[tuple[int, int]] = []

    def seen(setup: Setup) -> Setup:
        asked.append((setup.fec, setup.interleave))
        return grant(setup)

    got, statistics = exchange(tmp_path, data, seen, physics, fec="hamming")
    assert got == data
    assert statistics["bell_pairs"] == 160 * 23 // 2
    assert set(asked) == {(Fec.GOLAY, 1)}


def test_interleaved_golay_repeats_far_fewer_frames_than_no_code(tmp_path: Path) -> None:
    """Counted with seed 1 in 512 frames: none 1352, Golay 44, Golay interleaved 13.

    In theory without a code, with symbol errors 3p/4: 1228 with standard deviation 65.
    """
    data = np.random.default_rng(1).bytes(512 * 8)
    noise = {"depolarizing": 1 - 0.95 ** (1 / 6)}  # p = 0.05 over the six fibres
    repeated: list[int] = []
    for fec, interleave in (("none", False), ("golay", False), ("golay", True)):
        folder = tmp_path / str(len(repeated))
        folder.mkdir()
        got, statistics = exchange(
            folder, data, physics=noise, frame_bytes=8, fec=fec, interleave=interleave
        )
        assert got == data
        repeated.append(statistics["repeated_frames"])
    uncoded, golay, interleaved = repeated
    assert abs(uncoded - 1228) < 5 * 65
    assert golay < 100
    assert interleaved < 20


def linear(rotation: Pauli, **noise: float) -> tuple[Judge, dict[str, Any]]:
    """Return a controller and physics of linear optics behind a rotation."""

    def announced(setup: Setup) -> Setup:
        return replace(setup, verdict=Verdict.GRANTED, rotation=rotation)

    return announced, {"rotation": rotation, "analyser": "linear", **noise}


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("handshake", ["framed", "per-pair"])
@pytest.mark.parametrize("rotation", list(Pauli))
def test_linear_optics_delivers_eleven_bits_in_seven_pairs(
    tmp_path: Path, handshake: str, rotation: Pauli
) -> None:
    data = bytes(range(200, 211))  # 8 groups of eleven bits
    got, statistics = exchange(tmp_path, data, *linear(rotation), handshake=handshake)
    assert got == data
    assert statistics["symbols"] == 3
    assert statistics["bell_pairs"] == 8 * 7
    assert statistics["repeated_frames"] == 0


@pytest.mark.parametrize(("handshake", "size"), [("framed", 1024), ("per-pair", 8)])
def test_linear_optics_works_with_a_code_over_fibres_that_lose_and_depolarise(
    tmp_path: Path, handshake: str, size: int
) -> None:
    data = np.random.default_rng(2).bytes(size)
    physics = linear(Pauli.X, **LESS_NOISY)
    got, statistics = exchange(
        tmp_path, data, *physics, handshake=handshake, fec="golay", interleave=True
    )
    assert got == data
    if handshake == "framed":  # some 5,000 pairs: 35 are lost
        assert statistics["lost_pairs"] > 0
        assert statistics["filled_symbols"] > 0


def test_linear_optics_with_dibits_would_deliver_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(encoding.DISTINGUISHABLE_STATES, "linear", 4)
    with pytest.raises(QuantumSocketError, match="failed its check 64 times"):
        exchange(tmp_path, b"\xaa" * 8, *linear(Pauli.I))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"fec": 9}, "error-correction code 9 is not known; offered are 0 \\(none\\)"),
        ({"frame_bytes": 65_536, "fec": 1}, "needs 786432 pairs, at most 262144"),
    ],
)
def test_a_receiver_refuses_codes_it_does_not_know_and_frames_too_long(
    tmp_path: Path, change: dict[str, int], words: str
) -> None:
    def other(setup: Setup) -> Setup:
        asked: dict[str, Any] = change if setup.service == Service.SDC else {}
        return replace(setup, verdict=Verdict.GRANTED, **asked)

    with pytest.raises(QuantumSocketError, match=words) as caught:
        exchange(tmp_path, b"x", other)
    assert caught.value.reason == Reason.UNSUPPORTED


def test_light_of_another_wavelength_than_the_switch_is_tuned_to_is_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sender, "DARK_LIMIT_S", 0.5)

    def another_wavelength(setup: Setup) -> Setup:
        source = setup.service == Service.PAIR_SOURCE
        wavelength_pm = 1_549_720 if source else setup.wavelength_pm
        return replace(setup, verdict=Verdict.GRANTED, wavelength_pm=wavelength_pm)

    with pytest.raises(QuantumSocketError, match="no light from charlie") as caught:
        exchange(tmp_path, b"x", another_wavelength)
    assert caught.value.reason == Reason.NO_LIGHT


def test_a_source_refuses_what_is_no_wavelength_of_light(tmp_path: Path) -> None:
    def no_wavelength(setup: Setup) -> Setup:
        source = setup.service == Service.PAIR_SOURCE
        wavelength_pm = 1 if source else setup.wavelength_pm
        return replace(setup, verdict=Verdict.GRANTED, wavelength_pm=wavelength_pm)

    with pytest.raises(QuantumSocketError, match="wavelength 1 pm is not"):
        exchange(tmp_path, b"x", no_wavelength)


def test_modulated_light_leaves_with_the_wavelength_of_its_session(tmp_path: Path) -> None:
    paulis, rate_hz = np.zeros(100, np.uint8), 50_000_000

    async def lost_at_alices_port(wavelength_pm: int) -> int:
        folder = tmp_path / str(wavelength_pm % 1000)  # the path of a socket must be short
        folder.mkdir()
        dispatcher = str(folder / "dispatcher.sock")
        async with network(folder):
            charlie, alice = (
                SimulatedQnic(f"unix:{dispatcher}", f"token of {name}", QNICS[name])
                for name in ("charlie", "alice")
            )
            light = ("charlie-q0", "charlie-q1")
            await pair_light.emit_pairs(charlie, 9, 0, 100, light, Pulses(rate_hz, 1_550_120))
            name = BlockName(9, 0, 0)
            pulses = Pulses(rate_hz, wavelength_pm)
            await pair_light.modulate(alice, name, paulis, "alice-q0", pulses, 5.0)
            await alice.close()
            await charlie.close()
            return await photons_lost(dispatcher, PORTS["alice-q0"])

    assert network_loop.run(lost_at_alices_port(1_550_120)) == 0
    assert network_loop.run(lost_at_alices_port(1_549_720)) == 100


async def photons_lost(dispatcher: str, port: int) -> int:
    """Return how many photons the switch has lost of those that came by a port."""
    async with grpc.aio.insecure_channel(f"unix:{dispatcher}") as channel:
        stub: Any = DispatcherStub(channel)  # type: ignore[no-untyped-call]
        request = SwitchStatisticsRequest(switch="q1")
        metadata = dispatcher_service.metadata("token of runner")
        reply = await stub.SwitchStatistics(request, metadata=metadata)
    lost: int = next(one.photons_lost for one in reply.ports if one.port == port)
    return lost


def test_a_sender_that_gives_up_in_mid_send_ends_the_session_at_once(tmp_path: Path) -> None:
    def give_up(folder: Path) -> None:
        with QuantumSocket(folder / "bob.sock") as listener:
            listener.settimeout(SOON_S)
            listener.listen(7)
            with QuantumSocket(folder / "alice.sock") as sender:
                sender.connect(("bob", 7), rate_hz=1000, block_pairs=4000)
                sender.settimeout(0.2)
                receiver, _peer = listener.accept()
                with pytest.raises(TimeoutError):
                    sender.sendall(bytes(40_000))  # takes minutes
            with receiver, pytest.raises(QuantumSocketError, match="mid-session"):
                receiver.recv(1)

    async def run() -> None:
        async with network(tmp_path, grant):
            await asyncio.to_thread(give_up, tmp_path)

    network_loop.run(run())


def test_a_host_that_hears_late_of_its_light_does_not_take_it_for_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As where it is too busy for its whole patience: the dispatcher knows what has come."""
    modulate = pair_light.modulate

    async def heard_late(*arguments: Any) -> int:
        first_ns = await modulate(*arguments)
        await asyncio.sleep(0.2)
        return first_ns

    monkeypatch.setattr(pair_light, "modulate", heard_late)
    monkeypatch.setattr(opener, "GRACE_S", -1.0)
    got, statistics = exchange(tmp_path, b"twelve bytes")
    assert got == b"twelve bytes"
    assert statistics["lost_pairs"] == 0


@pytest.mark.parametrize("reason", [Reason.BUSY, Reason.NO_PATH, Reason.SWITCH_TIMEOUT])
def test_a_refusal_reaches_the_application_with_its_reason(tmp_path: Path, reason: Reason) -> None:
    def refuse(setup: Setup) -> Setup:
        return replace(setup, verdict=Verdict.REFUSED, reason=reason)

    with pytest.raises(QuantumSocketError) as caught:
        exchange(tmp_path, b"x", refuse)
    assert caught.value.reason == reason


def test_a_set_up_without_a_verdict_is_refused(tmp_path: Path) -> None:
    with pytest.raises(QuantumSocketError, match="no controller has granted") as caught:
        exchange(tmp_path, b"x", lambda setup: setup)
    assert caught.value.reason == Reason.NOT_ARBITRATED


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"handshake": "psychic"}, "handshake 'psychic': choose one of framed, per-pair"),
        ({"frame_bytes": 0}, "frame_bytes 0: choose 1 to 65536"),
        ({"block_pairs": 1 << 20}, "block_pairs 1048576"),
        ({"rate_hz": "fast"}, "rate_hz 'fast'"),
        ({"colour": "red"}, "a session has no colour: choose one of host, port"),
        ({"fec": "turbo"}, "fec 'turbo': choose one of none, repetition, hamming, golay, reed-"),
        ({"fec": 3}, "fec 3: choose one of"),
        ({"interleave": 1}, "interleave 1: choose True or False"),
        ({"fec": "golay", "frame_bytes": 65_536}, "the code golay .* needs 502"),
    ],
)
def test_a_bad_option_is_named(tmp_path: Path, options: dict[str, Any], words: str) -> None:
    with pytest.raises(QuantumSocketError, match=words):
        exchange(tmp_path, b"x", **options)


def on_network(folder: Path, act: Callable[[], None]) -> None:
    """Run the network around a function that uses sockets."""

    async def run() -> None:
        async with network(folder):
            await asyncio.to_thread(act)

    network_loop.run(run())


def test_an_unknown_host_is_named_with_those_that_are_known(tmp_path: Path) -> None:
    def act() -> None:
        with (
            QuantumSocket(tmp_path / "alice.sock") as sender,
            pytest.raises(QuantumSocketError, match=r"unknown host 'mallory'.*alice, bob, charlie"),
        ):
            sender.connect(("mallory", 7))

    on_network(tmp_path, act)


def test_a_port_without_a_listener_refuses(tmp_path: Path) -> None:
    def act() -> None:
        with (
            QuantumSocket(tmp_path / "alice.sock") as sender,
            pytest.raises(QuantumSocketError, match="no application listens on port 8"),
        ):
            sender.connect(("bob", 8))

    on_network(tmp_path, act)


def test_a_port_can_be_listened_on_once(tmp_path: Path) -> None:
    def act() -> None:
        with (
            QuantumSocket(tmp_path / "bob.sock") as first,
            QuantumSocket(tmp_path / "bob.sock") as second,
        ):
            first.listen(7)
            with pytest.raises(QuantumSocketError, match="port 7 is taken"):
                second.listen(7)

    on_network(tmp_path, act)


def test_who_waits_at_a_port_that_is_closed_is_told(tmp_path: Path) -> None:
    def act() -> None:
        with ThreadPoolExecutor(1) as pool:
            listener = QuantumSocket(tmp_path / "bob.sock")
            listener.settimeout(SOON_S)
            listener.listen(7)
            waiting = pool.submit(listener.accept)
            with pytest.raises(TimeoutError):
                waiting.result(0.2)
            listener.close()
            with pytest.raises(QuantumSocketError, match="listens on port 7 has been closed"):
                waiting.result(SOON_S)

    on_network(tmp_path, act)


def test_a_missing_stack_is_named(tmp_path: Path) -> None:
    with pytest.raises(QuantumSocketError, match="no host stack answers"):
        QuantumSocket(tmp_path / "nowhere.sock")


def test_lists_in_lists_without_end_are_an_error_of_that_application_alone(tmp_path: Path) -> None:
    def ask(_folder: Path) -> str:
        with socket.socket(socket.AF_UNIX) as application:
            application.settimeout(SOON_S)
            application.connect(str(tmp_path / "bob.sock"))
            application.sendall(encode(Call.REQUEST, b"[" * 100_000))
            stream = application.makefile("rb")
            call, length = decode_header(stream.read(CALL_HEADER.size))
            assert call == Call.FAILED
            return str(decode_fields(stream.read(length))["text"])

    async def run() -> None:
        async with network(tmp_path):
            assert "socket call is not JSON" in await asyncio.to_thread(ask, tmp_path)
            got, _ = await asyncio.to_thread(transfer, tmp_path, b"still here")
            assert got == b"still here"

    network_loop.run(run())


def test_rubbish_on_the_metadata_port_ends_that_connection_alone(tmp_path: Path) -> None:
    async def run() -> None:
        async with network(tmp_path):
            reader, writer = await asyncio.open_connection(OWN_ADDRESS["bob"], METADATA_PORT)
            writer.write(b"GET / HTTP/1.1\r\n\r\n")
            answer = decode(await asyncio.wait_for(reader.read(), SOON_S))
            assert getattr(answer, "reason", None) == Reason.PROTOCOL
            writer.close()
            got, _ = await asyncio.to_thread(transfer, tmp_path, b"still here")
            assert got == b"still here"

    network_loop.run(run())
