"""The gathering of machines for one network: the runner listens, and an agent on each connects."""

import asyncio
import socket
import ssl
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Thread

from topologies.system.certificates import CertificateAuthority, CertificateFiles
from topologies.system.kernel.interfaces import interface_with
from topologies.system.machines.machine import Machine
from topologies.system.machines.source import fingerprint
from topologies.system.machines.tunnel import OVERHEAD_BYTES
from topologies.system.processes.programs import NetworkError
from topologies.timeouts import AGENT_CONNECT_TIMEOUT_S, AGENT_END_TIMEOUT_S, POLL_S
from wire.machine_channel import receive

COPPER_MTU = 1500
KEY_LOG = "machines.keys"  # file in the folder of the run

# Begins the agent of a name, by the runner's address, its authority's certificate, and the
# agent's own with its key, all PEM.
Begin = Callable[[str, str, dict[str, str]], None]


@contextmanager
def gathered(
    addresses: Mapping[str, str], begin: Begin, logs: Path | None, check: Callable[[], None]
) -> Iterator[dict[str, Machine]]:
    """Give the machines with these names and IPv4 addresses, until this context ends.

    In the folder of logs is then a file of secrets, by which Wireshark reads what goes to them.
    Raise NetworkError for one that does not come; `check` may raise meanwhile.
    """
    loop = asyncio.new_event_loop()
    thread = Thread(target=loop.run_forever, name="machines", daemon=True)
    thread.start()
    gathering = Gathering(addresses, logs, loop)
    try:
        with TemporaryDirectory(prefix="qmn-machines-") as folder:
            gathering.call(Path(folder) / "certificates", begin)
            gathering.wait(check)
        yield gathering.found
    finally:
        asyncio.run_coroutine_threadsafe(gathering.end(), loop).result(AGENT_END_TIMEOUT_S)
        loop.call_soon_threadsafe(loop.stop)
        thread.join(AGENT_END_TIMEOUT_S)
        loop.close()


class Gathering:
    """Those that are to come, and those that have."""

    def __init__(
        self, addresses: Mapping[str, str], logs: Path | None, loop: asyncio.AbstractEventLoop
    ) -> None:
        self._addresses, self._logs, self._loop = addresses, logs, loop
        self._here = {name: address_towards(each) for name, each in addresses.items()}
        self._servers: list[asyncio.Server] = []
        self._refused = ""
        self.found: dict[str, Machine] = {}

    def call(self, folder: Path, begin: Begin) -> None:
        """Listen, and let an agent begin on each machine."""
        authority = CertificateAuthority(folder, "machines of a qmn network")
        certificate = authority.issue(
            "runner", {f"r{n}": a for n, a in enumerate(set(self._here.values()))}
        )
        context = trust(authority.certificate, certificate)
        if self._logs is not None:
            log_keys(context, self._logs / KEY_LOG)
        listening = asyncio.run_coroutine_threadsafe(self._listen(context), self._loop).result(
            AGENT_CONNECT_TIMEOUT_S
        )
        for name, here in self._here.items():
            files = authority.issue(name)
            texts = {
                "authority": authority.certificate.read_text(),
                "certificate": files.certificate.read_text(),
                "private_key": files.private_key.read_text(),
            }
            begin(name, f"{here}:{listening[here]}", texts)

    async def _listen(self, context: ssl.SSLContext) -> dict[str, int]:
        ports = {}
        for here in set(self._here.values()):
            server = await asyncio.start_server(self._welcome, here, 0, ssl=context)
            self._servers.append(server)
            ports[here] = server.sockets[0].getsockname()[1]
        return ports

    async def _welcome(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Take in a machine that introduces itself, as its certificate names it, or is known."""
        message = await receive(reader)
        subject = writer.get_extra_info("peercert")["subject"]
        certified = next(value for ((key, value),) in subject if key == "commonName")
        if message is not None and "relay" in message[0] and certified in self.found:
            self.found[certified].take_relayed(message[0]["relay"], (reader, writer))
            return
        if message is None or message[0].get("name") != certified or certified in self.found:
            writer.close()
            return
        about = message[0]
        if about["source"] != fingerprint():
            self._refused = (
                f"{certified} has another version of qmn, or of Python, than this machine"
            )
            writer.close()
            return
        here, address = self._here[certified], self._addresses[certified]
        mtu = min(COPPER_MTU, interface_with(here)[1] - OVERHEAD_BYTES)
        self.found[certified] = Machine(about, address, here, mtu, reader, writer)

    def wait(self, check: Callable[[], None]) -> None:
        deadline = time.monotonic() + AGENT_CONNECT_TIMEOUT_S
        while missing := sorted(self._addresses.keys() - self.found.keys()):
            check()
            if self._refused:
                raise NetworkError(f"{self._refused}: update both to the same")
            if time.monotonic() > deadline:
                here = ", ".join(sorted(set(self._here.values())))
                raise NetworkError(
                    f"no agent has connected from {', '.join(missing)} in "
                    f"{AGENT_CONNECT_TIMEOUT_S:g} s: can they reach {here}?"
                )
            time.sleep(POLL_S)

    async def end(self) -> None:
        for server in self._servers:
            server.close()
        await asyncio.gather(*(machine.close() for machine in self.found.values()))


def trust(authority: Path, certificate: CertificateFiles) -> ssl.SSLContext:
    """Return what the runner's side of the channel is to be: only what it has signed may come."""
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH, cafile=authority)
    context.minimum_version = ssl.TLSVersion.TLSv1_3
    context.verify_mode = ssl.CERT_REQUIRED
    context.load_cert_chain(certificate.certificate, certificate.private_key)
    return context


def log_keys(context: ssl.SSLContext, file: Path) -> None:
    """Write the secrets of all its connections into a file that only its owner can read."""
    file.touch(mode=0o600)
    context.keylog_filename = str(file)


def address_towards(address: str) -> str:
    """Return this machine's IPv4 address on the way to another one."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((address, 9))
        except OSError as error:
            raise NetworkError(f"there is no way to {address}: {error.strerror}") from error
        return str(probe.getsockname()[0])
