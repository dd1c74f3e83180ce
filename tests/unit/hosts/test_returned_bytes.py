"""Superdense coding back on the light of another session: halves change places, bytes are right."""

import asyncio
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from limits import SOON_S
from stacks_scene import live_qubits, network

from hosts import network_loop
from hosts.quantum_socket import QuantumSocket
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Verdict
from wire.outcomes import Pauli

DATA = bytes(range(256)) * 4
# As the light of a session of bob to alice comes: half 1 to alice, who passes it on, half 0 to bob.
MIRRORED = [(5, 1), (1, 3), (4, 2)]


def returned(folder: Path) -> tuple[bytes, dict[str, int]]:
    """Let alice send on the light of another session; return what bob got, and her statistics."""
    with (
        QuantumSocket(folder / "bob.sock") as listener,
        QuantumSocket(folder / "alice.sock") as sender,
    ):
        for each in (listener, sender):
            each.settimeout(SOON_S)
        listener.listen(7, "sdc_return")
        assert list(sender.request("sdc_return", ("bob", 7), frame_bytes=64)) == []
        receiver, _peer = listener.accept()
        with receiver:
            sender.sendall(DATA)
            sender.shutdown()
            got = b""
            while part := receiver.recv(1 << 16):
                got += part
        return got, sender.statistics


@pytest.mark.parametrize("rotation", list(Pauli))
@pytest.mark.parametrize(("analyser", "pairs"), [("complete", 4 * 1024), ("linear", None)])
def test_bytes_come_back_whatever_the_paths_turn(
    tmp_path: Path, rotation: Pauli, analyser: str, pairs: int | None
) -> None:
    def tell(setup: Setup) -> Setup:  # three paths, each of which turns as the switch does
        return replace(setup, verdict=Verdict.GRANTED, rotation=rotation)

    async def scene() -> tuple[bytes, dict[str, int], int]:
        physics: dict[str, Any] = {"rotation": rotation, "analyser": analyser, "paths": MIRRORED}
        async with network(tmp_path, tell, **physics) as folder:
            got, used = await asyncio.to_thread(returned, folder)
            return got, used, await live_qubits(folder)

    got, used, live = network_loop.run(scene())
    assert (got, live) == (DATA, 0)
    assert used["lost_pairs"] == used["symbol_errors"] == 0
    assert pairs in (None, used["bell_pairs"])  # two bits a pair
