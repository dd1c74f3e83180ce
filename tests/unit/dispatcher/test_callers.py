"""Callers of the dispatcher over a network: proof for each call, and no token on the wire."""

from collections.abc import Awaitable, Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import grpc
import pytest
import uvloop
from dispatcher_network import JumpingClock, configuration, running
from limits import SOON_S

from dispatcher.server import callers
from dispatcher.server.callers import Challenges
from topologies.system.certificates import CertificateAuthority
from topologies.system.runs.runtime import free_port
from wire.credentials import Credentials
from wire.dispatcher_pb2 import ChallengeRequest, StatusRequest
from wire.dispatcher_pb2_grpc import DispatcherStub
from wire.dispatcher_service import NONCE_BYTES, metadata, proof, proving

NONCE = bytes(range(NONCE_BYTES))
GOLDEN = "bdb7662ff651382c595962ef5690065db154ad520ef8adc76938807f23a10ac1"
Act = Callable[[Any, Any], Awaitable[None]]


def on_two_connections(folder: Path, act: Act) -> None:
    """Do something with two TCP connections to a dispatcher."""

    async def run() -> None:
        address = f"127.0.0.1:{free_port()}"
        config = replace(configuration(folder), listen=address)
        async with running(config, JumpingClock()):
            options = [("grpc.use_local_subchannel_pool", 1)]
            async with (
                grpc.aio.insecure_channel(address, options) as one,
                grpc.aio.insecure_channel(address, options) as other,
            ):
                stubs = [DispatcherStub(channel) for channel in (one, other)]  # type: ignore[no-untyped-call]
                await act(*stubs)

    uvloop.run(run())


async def nonce_of(stub: Any) -> bytes:
    return bytes((await stub.Challenge(ChallengeRequest(), timeout=SOON_S)).nonce)


async def refused(stub: Any, report: Any, words: str) -> None:
    with pytest.raises(grpc.aio.AioRpcError) as caught:
        await stub.Status(StatusRequest(), metadata=report, timeout=SOON_S)
    assert caught.value.code() == grpc.StatusCode.UNAUTHENTICATED
    assert words in (caught.value.details() or "")


def test_a_proof_counts_once_for_its_method_on_its_connection(tmp_path: Path) -> None:
    async def act(one: Any, other: Any) -> None:
        token = "token of runner"
        report = proving(token, await nonce_of(one), "Status")
        await refused(other, report, "not of this connection")
        await one.Status(StatusRequest(), metadata=report, timeout=SOON_S)
        await refused(one, report, "was used before")
        await refused(one, proving(token, await nonce_of(one), "Watch"), "no node's token proves")
        await refused(one, proving("wrong", await nonce_of(one), "Status"), "no node's token")
        await refused(one, proving(token, NONCE, "Status"), "not of this connection")
        await refused(one, (("qmn-nonce", "no hex"), ("qmn-proof", "ü".encode().hex())), "not of")
        await refused(one, (("qmn-proof", "00"),), "not of this connection")

    on_two_connections(tmp_path, act)


def test_a_token_that_comes_over_a_network_is_not_taken(tmp_path: Path) -> None:
    async def act(one: Any, _other: Any) -> None:
        await refused(one, metadata("token of runner"), "a token came over the network")
        await refused(one, (), "no token in the call's metadata")

    on_two_connections(tmp_path, act)


def test_by_tls_a_call_is_of_whom_proof_and_certificate_name(tmp_path: Path) -> None:
    authority = CertificateAuthority(tmp_path / "tls", "a run")
    ca = str(authority.certificate)

    def certified(name: str, **addresses: str) -> Credentials:
        files = authority.issue(name, addresses)
        return Credentials(ca, str(files.certificate), str(files.private_key))

    async def run() -> None:
        address = f"127.0.0.1:{free_port()}"
        config = replace(
            configuration(tmp_path), listen=address, credentials=certified("ed", ed="127.0.0.1")
        )
        pem, certificate, private_key = certified("alice").read()
        shown = grpc.ssl_channel_credentials(pem, private_key, certificate)
        async with running(config, JumpingClock()):
            async with grpc.aio.secure_channel(address, shown) as channel:
                alice: Any = DispatcherStub(channel)  # type: ignore[no-untyped-call]
                report = proving("token of alice", await nonce_of(alice), "Perform")
                call = alice.Perform(iter(()), metadata=report, timeout=SOON_S)
                assert [outcome async for outcome in call] == []
                report = proving("token of bob", await nonce_of(alice), "Status")
                await refused(alice, report, "the proof is bob's, and the certificate of alice")
            without = grpc.ssl_channel_credentials(pem)
            for other in (
                grpc.aio.insecure_channel(address),
                grpc.aio.secure_channel(address, without),
            ):
                async with other:
                    with pytest.raises(grpc.aio.AioRpcError) as caught:
                        await nonce_of(DispatcherStub(other))  # type: ignore[no-untyped-call]
                    assert caught.value.code() == grpc.StatusCode.UNAVAILABLE

    uvloop.run(run())


def test_the_proof_is_golden() -> None:
    # Computed by openssl over "call", the challenge and the name of the method.
    assert proof("0123456789abcdef", NONCE, "Perform") == GOLDEN


def test_nobody_crowds_out_the_challenges_of_another(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(callers, "MAX_OF_ONE", 3)
    monkeypatch.setattr(callers, "MAX_CHALLENGES", 5)
    given = Challenges()
    mine = given.give("ipv4:10.0.0.1:40000")
    others = [given.give(f"ipv4:10.0.0.2:{port}") for port in range(10)]
    assert [given.take(nonce.hex(), f"ipv4:10.0.0.2:{port}") for port, nonce in enumerate(others)][
        :7
    ] == [None] * 7
    assert given.take(mine.hex(), "ipv4:10.0.0.1:40000") == mine
    assert given.take(mine.hex(), "ipv4:10.0.0.1:40000") is None
    for port in range(10):  # of as many addresses
        given.give(f"ipv4:10.0.1.{port}:1")
    assert len(given._peers) == 5
