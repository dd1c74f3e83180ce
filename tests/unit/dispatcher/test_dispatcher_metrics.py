"""The dispatcher tells Prometheus its metrics, over a socket that it is handed."""

import asyncio
import socket
import urllib.request
from pathlib import Path

import uvloop
from dispatcher_network import JumpingClock, block, configuration, running
from limits import SOON_S
from prometheus_client.parser import text_string_to_metric_families

from dispatcher.server.server import MeasuredService, metrics
from wire.dispatcher_pb2 import MeasureRequest, Order, Step


def samples(address: str) -> dict[str, float]:
    """Return every sample by its name, and its rpc if it has one."""
    with urllib.request.urlopen(f"http://{address}/metrics", timeout=SOON_S) as response:
        families = text_string_to_metric_families(response.read().decode())
    samples = [sample for family in families for sample in family.samples]
    return {" ".join((s.name, *s.labels.values())): s.value for s in samples}


def test_pairs_losses_live_qubits_and_calls_are_told(tmp_path: Path) -> None:
    async def run() -> None:
        listener = socket.create_server(("127.0.0.1", 0))
        address = "{}:{}".format(*listener.getsockname())
        config = configuration(tmp_path, metrics_fd=listener.detach())
        async with running(config, JumpingClock()) as bench:
            assert isinstance(bench.service, MeasuredService)
            async with metrics(config, bench.service):
                before = await asyncio.to_thread(samples, address)
                await bench.charlie.create(500)
                await bench.charlie.send((block(), "charlie-q0"))  # no path: it is lost
                step = Step(measure=MeasureRequest(block=block(half=1)))
                orders = iter([Order(number=1, steps=[step])])
                metadata = bench.charlie.metadata
                [outcome async for outcome in bench.stub.Perform(orders, metadata=metadata)]
                await bench.alice.create(20, number=1)
                after = await asyncio.to_thread(samples, address)
        assert before["qmn_live_qubits"] == before["qmn_pairs_created_total"] == 0
        assert after["qmn_pairs_created_total"] == 520
        assert after["qmn_photons_lost_total"] == 500
        assert after["qmn_live_qubits"] == 40
        assert after["qmn_rpc_seconds_count create"] == 2
        assert after["qmn_rpc_seconds_count measure"] == 1  # also a step of an order
        assert after["qmn_rpc_seconds_sum send"] > 0

    uvloop.run(asyncio.wait_for(run(), 20))
