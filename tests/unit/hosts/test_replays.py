"""Set-up messages that are sent again or made up: they open nothing, and disturb nobody."""

import asyncio
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import pytest
from fault_scene import DATA, PORT, SERVICES, Once, require_no_session, running, session
from limits import SOON_S
from stacks_scene import OWN_ADDRESS, arbitrated, grant

from applications.key_distribution import acceptor as key_acceptor
from applications.key_distribution import light as key_light
from hosts import network_loop
from hosts.middleware.session import protocol
from hosts.middleware.session.channel import MetadataChannel
from hosts.middleware.session.errors import SessionError
from hosts.quantum_socket import QuantumSocket
from hosts.service_socket import ServiceSocket
from hosts.serving.active_sessions import MAX_OF_ONE
from wire.metadata.blocks import Block, Emission, Emit, Finish
from wire.metadata.decoding import decode
from wire.metadata.header import HEADER, METADATA_PORT, Message
from wire.metadata.setup import SETUP_LENGTH, Answer, Setup
from wire.metadata.vocabulary import Reason, Service

services = pytest.mark.parametrize("service_name", SERVICES)


class Recorder:
    """Grants everything, and keeps it as it was granted: whom it was for, and what it says."""

    def __init__(self) -> None:
        self.granted: list[Setup] = []

    def __call__(self, setup: Setup) -> Setup:
        made = grant(setup)
        self.granted.append(made)
        return made


def host_of(setup: Setup, acceptor: str = "bob") -> str:
    """Return who serves such a set-up."""
    return "charlie" if setup.service == Service.PAIR_SOURCE else acceptor


async def sent(setup: Setup, host: str, sender: str = "127.0.0.1") -> SessionError | None:
    """Send a set-up that the controller grants; return how it is refused, None if it is not."""
    place = OWN_ADDRESS[host], METADATA_PORT
    channel = MetadataChannel(*await asyncio.open_connection(*place, local_addr=(sender, 0)))
    try:
        await channel.request(arbitrated(setup, host, channel))
    except SessionError as error:
        return error
    finally:
        channel.close()
    return None


def require_refused(errors: list[SessionError | None], reason: Reason, words: str) -> None:
    assert errors
    for error in errors:
        assert error is not None
        assert error.reason == reason
        assert words in str(error)


@services
def test_a_set_up_that_is_sent_again_in_mid_session_disturbs_nobody(
    tmp_path: Path, service_name: str
) -> None:
    recorder, errors = Recorder(), list[SessionError | None]()

    async def replay(message: Message) -> Message:
        errors.extend([await sent(setup, host_of(setup)) for setup in first_of_each(recorder)])
        return message

    async def run() -> None:
        change = Once(lambda way, message: way == "forth" and isinstance(message, Finish), replay)
        async with running(tmp_path, service_name, recorder, change=change):
            report = await asyncio.to_thread(session, tmp_path, service_name)
            assert [each.text for each in report] == ["", ""]

    network_loop.run(run())
    require_refused(errors, Reason.BUSY, "is under way here: is its set-up message a replay?")


def first_of_each(recorder: Recorder) -> list[Setup]:
    """Return the set-ups that went to different hosts."""
    return list({host_of(setup): setup for setup in reversed(recorder.granted)}.values())


@pytest.mark.by_day(every=2)
@services
def test_a_set_up_that_is_sent_again_later_opens_nothing(tmp_path: Path, service_name: str) -> None:
    recorder = Recorder()

    async def run() -> list[SessionError | None]:
        async with running(tmp_path, service_name, recorder) as stacks:
            await asyncio.to_thread(session, tmp_path, service_name)
            await require_no_session(stacks)
            with await asyncio.to_thread(_listening, tmp_path, service_name):
                setups = first_of_each(recorder)
                return [await sent(setup, host_of(setup)) for setup in setups]

    errors = network_loop.run(run())
    require_refused(errors, Reason.UNKNOWN_SESSION, "was here before: is its set-up message a")


def _listening(folder: Path, service_name: str) -> QuantumSocket | ServiceSocket:
    """Let an application of bob wait for sessions."""
    if service_name == "sdc":
        listener = QuantumSocket(folder / "bob.sock")
        listener.listen(PORT)
        return listener
    waiting = ServiceSocket(folder / "bob.sock")
    waiting.listen(PORT, service_name)
    return waiting


@pytest.mark.by_day(every=11)
@pytest.mark.parametrize(
    ("service_name", "other"),
    [*product(SERVICES, SERVICES)],
)
def test_no_other_service_is_opened_with_the_number_of_a_session(
    tmp_path: Path, service_name: str, other: str
) -> None:
    """Its end would let go of the photons of the session under way."""
    recorder, errors = Recorder(), list[SessionError | None]()
    port = PORT + 1

    async def forge(message: Message) -> Message:
        opening = recorder.granted[0]
        forged = replace(opening, service=Service[other.upper()], port=port, pairs=1000)
        hosts = ("alice", "bob")
        with ServiceSocket(tmp_path / "bob.sock") as listener:
            await asyncio.to_thread(listener.listen, port, other)
            errors.extend([await sent(forged, host) for host in hosts])
        return message

    async def run() -> None:
        change = Once(lambda way, message: way == "forth" and isinstance(message, Finish), forge)
        async with running(tmp_path, service_name, recorder, change=change):
            report = await asyncio.to_thread(session, tmp_path, service_name)
            assert [each.text for each in report] == ["", ""]

    network_loop.run(run())
    at_alice, at_bob = errors
    require_refused([at_bob], Reason.BUSY, "is under way here")
    assert at_alice is not None


@pytest.mark.parametrize("number", [0, 99, 255])
def test_a_service_that_nobody_knows_is_refused_by_its_number(tmp_path: Path, number: int) -> None:
    async def run() -> Answer:
        async with running(tmp_path, "teleport"):
            reader, writer = await asyncio.open_connection(OWN_ADDRESS["bob"], METADATA_PORT)
            setup = grant(Setup(7, Service["TELEPORT"], 1, "10.0.0.3", 10, 1, 1000, port=PORT))
            data = bytearray(setup.encode())
            assert len(data) == SETUP_LENGTH
            assert data[HEADER.size] == Service["TELEPORT"]
            data[HEADER.size] = number
            writer.write(bytes(data))
            answer = decode(await asyncio.wait_for(reader.read(), SOON_S))
            writer.close()
            assert isinstance(answer, Answer)
            return answer

    answer = network_loop.run(run())
    assert answer.reason == Reason.UNSUPPORTED
    assert f"asks for an unknown service {number}: choose one of 1 (SDC), 2 (PAIR" in answer.text


@pytest.fixture
def _short_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let nobody wait long for what does not come."""
    monkeypatch.setattr(protocol.hear, "__defaults__", (0.3,))
    monkeypatch.setattr(key_light, "KEY_GRACE_S", 0.1)
    monkeypatch.setattr(key_acceptor, "KEYS_TIMEOUT_S", 0.3)


@pytest.mark.usefixtures("_short_waits")
@pytest.mark.parametrize("service_name", SERVICES)
def test_who_has_been_granted_nothing_gets_no_light_and_holds_nothing(
    tmp_path: Path, service_name: str
) -> None:
    """A forged set-up that is past the controller; the forger then says nothing, and goes."""
    forged = grant(
        Setup(0xF0, Service[service_name.upper()], 1, "10.0.0.3", 64, 1, 1000, port=PORT)
    )

    async def run() -> None:
        async with running(tmp_path, service_name):
            with await asyncio.to_thread(_listening, tmp_path, service_name) as listener:
                accepting = asyncio.create_task(asyncio.to_thread(_outcome, listener))
                assert await sent(forged, "bob") is None
                assert "gone" in await accepting

    network_loop.run(run())


def _outcome(listener: QuantumSocket | ServiceSocket) -> str:
    listener.settimeout(SOON_S)
    accepted, _peer = listener.accept()
    with accepted:
        accepted.settimeout(SOON_S)
        try:
            if isinstance(accepted, ServiceSocket):
                list(accepted.results())
            else:
                accepted.recv(1)
        except ConnectionError as error:
            return str(error)
    return ""


@pytest.mark.parametrize(
    ("emit", "reason", "words"),
    [
        (Emit(5, 1, 0, 1000), Reason.UNSUPPORTED, "a block of 0 pairs: choose 1 to 4000000000"),
        (Emit(5, 1, 4_000_000_001, 1000), Reason.UNSUPPORTED, "a block of 4000000001 pairs: choo"),
        (Emit(5, 1, 262_145, 1000), Reason.HARDWARE, "262145 photons at rate_hz 1000 take 262 s"),
        (Emit(5, 1, 10, 0), Reason.NOT_ALLOWED, "0 pairs a second: 1000 at most were granted"),
        (Emit(5, 1, 10, 1001), Reason.NOT_ALLOWED, "1001 pairs a second: 1000 at most were gra"),
        (Emit(6, 1, 10, 1000), Reason.PROTOCOL, "sent Emit of session 0000000000000006 over a"),
        (Emission(5, 1, 10, 1001), Reason.NOT_ALLOWED, "1001 pairs a second: 1000 at most were"),
        (Finish(5, 0, bytes(32)), Reason.PROTOCOL, "Finish from 127.0.0.1 in mid-session, where"),
    ],
)
def test_a_source_makes_no_more_than_was_granted(
    tmp_path: Path, emit: Message, reason: Reason, words: str
) -> None:
    async def run() -> None:
        async with running(tmp_path, "teleport"):
            channel = await MetadataChannel.connect("charlie", OWN_ADDRESS["charlie"])
            setup = Setup(5, Service.PAIR_SOURCE, 1, OWN_ADDRESS["charlie"], 100, 1, 1000)
            await channel.request(arbitrated(setup, "charlie", channel))
            channel.send(emit)
            with pytest.raises(SessionError) as caught:
                await channel.receive(Answer, SOON_S)
            channel.close()
            assert caught.value.reason == reason
            assert words in str(caught.value)

    network_loop.run(run())


def test_who_has_its_share_of_a_hosts_sessions_keeps_nobody_else_out(tmp_path: Path) -> None:
    """It is counted by the address that its connections come from."""

    def asked(number: int) -> Setup:
        return Setup(number, Service.PAIR_SOURCE, 1, OWN_ADDRESS["charlie"], 100, 1, 1000)

    async def run() -> None:
        async with running(tmp_path, "teleport"):
            held = []
            for number in range(1, MAX_OF_ONE + 1):
                channel = await MetadataChannel.connect("charlie", OWN_ADDRESS["charlie"])
                await channel.request(arbitrated(asked(number), "charlie", channel))
                held.append(channel)
            words = f"{MAX_OF_ONE} sessions of 127.0.0.1 are under way here, its share"
            require_refused([await sent(asked(100), "charlie")], Reason.BUSY, words)
            assert await sent(asked(101), "charlie", OWN_ADDRESS["eve"]) is None
            for channel in held:
                channel.close()

    network_loop.run(run())


def test_a_pair_of_a_session_is_taken_once(tmp_path: Path) -> None:
    recorder, errors = Recorder(), list[SessionError | None]()

    async def replay(message: Message) -> Message:
        pairs = [setup for setup in recorder.granted if setup.block]
        errors.extend([await sent(setup, "bob") for setup in (pairs[0], pairs[-1])])
        return message

    async def run() -> None:
        change = Once(lambda way, message: way == "forth" and isinstance(message, Finish), replay)
        async with running(tmp_path, "sdc", recorder, change=change):
            options: dict[str, Any] = {
                "handshake": "per-pair",
                "frame_bytes": 16,
                "block_pairs": 256,
                "data": DATA[:16],
            }
            report = await asyncio.to_thread(session, tmp_path, "sdc", **options)
            assert [each.text for each in report] == ["", ""]

    network_loop.run(run())
    require_refused(errors, Reason.PROTOCOL, "is not expected (any more): is its set-up a replay?")


def test_a_pair_of_a_session_is_taken_from_its_own_sender_alone(tmp_path: Path) -> None:
    """Another host asks first for a pair that the sender has yet to ask for."""
    recorder, errors = Recorder(), list[SessionError | None]()

    async def intrude(message: Message) -> Message:
        setup = next(setup for setup in recorder.granted if setup.block)
        errors.append(await sent(replace(setup, block=60), "bob", OWN_ADDRESS["eve"]))
        return message

    async def run() -> None:
        change = Once(lambda way, message: way == "forth" and isinstance(message, Block), intrude)
        async with running(tmp_path, "sdc", recorder, change=change):
            options: dict[str, Any] = {
                "handshake": "per-pair",
                "frame_bytes": 16,
                "block_pairs": 256,
                "data": DATA[:16],
            }
            report = await asyncio.to_thread(session, tmp_path, "sdc", **options)
            assert [each.text for each in report] == ["", ""]

    network_loop.run(run())
    assert max(setup.block for setup in recorder.granted) >= 60
    words = f"pair 60 of a session of 127.0.0.1 from {OWN_ADDRESS['eve']}"
    require_refused(errors, Reason.UNKNOWN_SESSION, words)
