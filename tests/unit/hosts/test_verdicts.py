"""Set-up messages that reach a host by themselves: only the controller's word counts."""

import asyncio
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from limits import SOON_S
from stacks_scene import OWN_ADDRESS, arbitrated, grant, network, sealed

from hosts import network_loop
from hosts.middleware.session.channel import MetadataChannel
from hosts.middleware.session.errors import SessionError
from hosts.service_socket import ServiceSocket
from hosts.serving import active_sessions
from hosts.serving.active_sessions import Verdicts
from wire.metadata.decoding import decode
from wire.metadata.setup import Answer, Setup
from wire.metadata.values import Values
from wire.metadata.vocabulary import Reason, Service, Verdict
from wire.verdict import seal

PORT = 9
SETUP = Setup(5, Service.DISTRIBUTE, 1, "10.0.0.9", 64, 1, 1000, port=PORT)
Forge = Callable[[MetadataChannel], Setup]
CONNECTION = "10.0.0.1", 40_000, "10.0.0.2", 9010


def as_seen_by_opener(channel: MetadataChannel) -> tuple[str, int, str, int]:
    return (*channel.connection[2:], *channel.connection[:2])


def from_another_port(channel: MetadataChannel) -> Setup:
    address, port, *there = as_seen_by_opener(channel)
    return sealed(grant(SETUP), "bob", (address, port + 1, *there))  # type: ignore[arg-type]


FORGERIES: dict[str, Forge] = {
    "a verdict without a seal": lambda _channel: grant(SETUP),
    "with a seal that is made up": lambda _channel: replace(grant(SETUP), seal=b"made up by me..."),
    "for another host": lambda channel: arbitrated(SETUP, "charlie", channel),
    "for another connection": from_another_port,
    "for another session": lambda channel: replace(arbitrated(SETUP, "bob", channel), session=6),
    "for a session of fewer pairs": lambda channel: replace(
        arbitrated(SETUP, "bob", channel), pairs=65
    ),
    "of a refusal": lambda channel: replace(
        sealed(replace(SETUP, verdict=Verdict.REFUSED), "bob", as_seen_by_opener(channel)),
        verdict=Verdict.GRANTED,
    ),
}


@pytest.mark.parametrize("forge", FORGERIES.values(), ids=FORGERIES)
def test_a_verdict_that_is_not_the_controllers_takes_no_listener(
    tmp_path: Path, forge: Forge
) -> None:
    async def run() -> None:
        async with network(tmp_path):
            with ServiceSocket(tmp_path / "bob.sock") as listener:
                await asyncio.to_thread(listener.listen, PORT, "distribute")
                channel = await MetadataChannel.connect("bob", OWN_ADDRESS["bob"])
                with pytest.raises(SessionError, match="does not carry the controller's seal") as e:
                    await channel.request(forge(channel))
                assert e.value.reason == Reason.NOT_ARBITRATED
                channel.close()
                # The listener is still there for what the controller grants.
                channel = await MetadataChannel.connect("bob", OWN_ADDRESS["bob"])
                answer = await channel.request(arbitrated(SETUP, "bob", channel), SOON_S)
                text = Answer(SETUP.session, Reason.OK, wavelength_pm=SETUP.wavelength_pm)
                assert answer == text
                await channel.receive(Values, SOON_S)
                channel.close()

    network_loop.run(run())


def test_a_refusal_that_is_not_the_controllers_is_not_taken_for_one(tmp_path: Path) -> None:
    refusal = replace(SETUP, verdict=Verdict.REFUSED, reason=Reason.NOT_ALLOWED)

    async def run() -> None:
        async with network(tmp_path):
            for message, reason in ((refusal, Reason.NOT_ARBITRATED), (None, Reason.NOT_ALLOWED)):
                channel = await MetadataChannel.connect("bob", OWN_ADDRESS["bob"])
                true = sealed(refusal, "bob", as_seen_by_opener(channel))
                with pytest.raises(SessionError) as caught:
                    await channel.request(message or true)
                assert caught.value.reason == reason
                channel.close()

    network_loop.run(run())


def test_a_verdict_counts_once(monkeypatch: pytest.MonkeyPatch) -> None:
    key = "00" * 16
    monkeypatch.setattr(active_sessions, "MAX_VERDICTS", 2)
    checks = Verdicts(key)
    granted = [_sealed(replace(grant(SETUP), session=number), key) for number in range(1, 4)]
    for setup in granted:
        checks.checked(setup, CONNECTION)
    for setup in granted[1:]:
        with pytest.raises(SessionError, match="has come before"):
            checks.checked(setup, CONNECTION)
    checks.checked(granted[0], CONNECTION)  # long ago


def test_a_host_without_a_device_key_takes_nobodys_word() -> None:
    with pytest.raises(SessionError, match="seal") as caught:
        Verdicts("").checked(_sealed(grant(SETUP), ""), CONNECTION)
    assert caught.value.reason == Reason.NOT_ARBITRATED


def test_standing_light_needs_no_verdict_but_believes_no_other() -> None:
    checks = Verdicts("00" * 16, standing=True)
    taken = checks.checked(SETUP, CONNECTION)
    assert taken == replace(SETUP, verdict=Verdict.GRANTED)
    with pytest.raises(SessionError, match="seal"):
        checks.checked(grant(SETUP), CONNECTION)
    with pytest.raises(SessionError) as caught:
        Verdicts("00" * 16).checked(SETUP, CONNECTION)
    assert caught.value.reason == Reason.NOT_ARBITRATED


def _sealed(setup: Setup, key: str) -> Setup:
    message = decode(seal(setup.encode(), key, CONNECTION))
    assert isinstance(message, Setup)
    return message
