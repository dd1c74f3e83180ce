"""Where switches come in by TLS: who is let in, and as whom."""

import asyncio
import ssl
import struct
from collections.abc import Awaitable, Callable
from contextlib import suppress
from pathlib import Path

import pytest
from limits import SOON_S

from controller_apps.tls import Entrance, Impostor, SwitchMessages
from topologies.system.certificates import CertificateAuthority
from topologies.system.runs.runtime import free_port
from wire.config import EntranceConfig
from wire.credentials import Credentials
from wire.malformed import MalformedPacket

HELLO = bytes.fromhex("0500000800000001")  # OpenFlow 1.4, section 7.5.1
IDS = {"s1": 1, "q1": 0x1001}


def features(datapath_id: int) -> bytes:
    """Return OFPT_FEATURES_REPLY, 32 bytes (section 7.3.1)."""
    return struct.pack("!BBHIQIBBHII", 5, 6, 32, 2, datapath_id, 0, 254, 0, 0, 0, 0)


def test_whole_messages_pass_wherever_they_are_cut() -> None:
    text = HELLO + features(0x1001) + HELLO
    for cut in range(len(text)):
        messages = SwitchMessages([0x1001])
        first = messages.feed(text[:cut])
        assert first == text[: len(first)]
        assert first + messages.feed(text[cut:]) == text


def test_no_word_of_another_switch_passes() -> None:
    for cut in range(33):
        messages, text = SwitchMessages([0x1001]), features(1)
        passed = messages.feed(text[:cut]) if cut < 32 else b""
        assert passed == b""
        with pytest.raises(Impostor, match="0x1"):
            messages.feed(text[cut:] if cut < 32 else text)


@pytest.mark.parametrize("text", ["0500000700000001", "0506000f00000001" + 7 * "00"])
def test_messages_that_are_too_short_end_the_connection(text: str) -> None:
    with pytest.raises(MalformedPacket):
        SwitchMessages([1]).feed(bytes.fromhex(text))


def credentials(authority: CertificateAuthority, name: str, **more: object) -> Credentials:
    files = authority.issue(name, **more)  # type: ignore[arg-type]
    return Credentials(str(authority.certificate), str(files.certificate), str(files.private_key))


def through(folder: Path, act: Callable[[int, CertificateAuthority], Awaitable[None]]) -> bytes:
    """Do something with an entrance, at a port; return what the framework behind it has heard."""

    async def run() -> bytes:
        heard = bytearray()

        async def framework(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            writer.write(HELLO)
            while data := await reader.read(1 << 16):
                heard.extend(data)
            writer.close()

        authority = CertificateAuthority(folder / "tls", "a run")
        (folder / "keys").touch()
        port = free_port(2)
        server = await asyncio.start_server(framework, "127.0.0.1", port + 1)
        entrance = Entrance(
            EntranceConfig(
                listen=[f"127.0.0.1:{port}"],
                controller=f"127.0.0.1:{port + 1}",
                credentials=credentials(authority, "c0", addresses={"c0-q1": "127.0.0.1"}),
                datapath_ids=IDS,
                key_log=str(folder / "keys"),
            )
        )
        await entrance.open()
        try:
            async with asyncio.timeout(4 * SOON_S):
                await act(port, authority)
        finally:
            entrance.close()
            server.close()
        return bytes(heard)

    return asyncio.run(run())


async def says(port: int, context: ssl.SSLContext, text: bytes) -> None:
    """Say something as a switch, and wait for the end."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port, ssl=context)
    writer.write(text)
    assert await reader.read() == b""
    writer.close()


@pytest.mark.parametrize("shown", [{"name": "q1"}, {"name": "open-vswitch", "also": ["q1", "s2"]}])
def test_a_switch_is_let_in_as_its_certificate_names_it(
    tmp_path: Path, shown: dict[str, object]
) -> None:
    async def act(port: int, authority: CertificateAuthority) -> None:
        context = credentials(authority, **shown).client()  # type: ignore[arg-type]
        reader, writer = await asyncio.open_connection("127.0.0.1", port, ssl=context)
        writer.write(HELLO + features(0x1001))
        assert await reader.readexactly(len(HELLO)) == HELLO
        writer.write(features(1) + HELLO)  # and then as another
        assert await reader.read() == b""
        writer.close()

    assert through(tmp_path, act) == HELLO + features(0x1001)
    # Both directions' secrets of TLS 1.3, as Wireshark wants them (the NSS key log format).
    lines = (tmp_path / "keys").read_text().splitlines()
    assert {line.split()[0] for line in lines} >= {
        "CLIENT_TRAFFIC_SECRET_0",
        "SERVER_TRAFFIC_SECRET_0",
        "CLIENT_HANDSHAKE_TRAFFIC_SECRET",
        "SERVER_HANDSHAKE_TRAFFIC_SECRET",
    }


def test_nobody_is_let_in_without_a_certificate_of_the_run(tmp_path: Path) -> None:
    async def act(port: int, authority: CertificateAuthority) -> None:
        without = ssl.create_default_context(cafile=authority.certificate)
        other = credentials(CertificateAuthority(tmp_path / "other", "another run"), "q1").client()
        other.load_verify_locations(authority.certificate)
        for context in (without, other):
            with suppress(ssl.SSLError, ConnectionError):  # or it ends without a word
                await says(port, context, features(0x1001))

    assert through(tmp_path, act) == b""


def test_a_switch_speaks_with_the_controller_of_its_run_alone(tmp_path: Path) -> None:
    async def act(port: int, authority: CertificateAuthority) -> None:
        another = CertificateAuthority(tmp_path / "other", "another run")
        with pytest.raises(ssl.SSLCertVerificationError):
            await says(port, credentials(another, "q1").client(), features(0x1001))
        q1 = credentials(authority, "q1").client()
        with pytest.raises(ssl.SSLCertVerificationError, match="mismatch"):
            await asyncio.open_connection("127.0.0.1", port, ssl=q1, server_hostname="127.0.0.2")

    assert through(tmp_path, act) == b""
