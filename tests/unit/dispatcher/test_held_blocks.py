"""The runner can ask which blocks a node holds, and where."""

from pathlib import Path

import uvloop
from dispatcher_network import JumpingClock, block, configuration, running

from wire.dispatcher_pb2 import HeldBlock, StatusRequest, StoreRequest


def test_the_status_lists_the_blocks_at_a_node_its_ports_and_its_memory(tmp_path: Path) -> None:
    async def inside() -> None:
        async with running(configuration(tmp_path), clock=JumpingClock()) as bench:
            await bench.switch.connect((1, 3))
            await bench.charlie.create(5)
            await bench.charlie.send((block(half=0), "charlie-q0"))
            await bench.charlie.act(StoreRequest(block=block(half=1)))

            async def at(node: str) -> list[HeldBlock]:
                reply = await bench.runner.call("Status", StatusRequest(blocks_at=node))
                return list(reply.blocks)

            waiting = HeldBlock(block=block(half=0), port="alice-q0", photons=5)
            assert await at("alice") == [waiting]
            assert await at("charlie") == [HeldBlock(block=block(half=1), photons=5, stored=True)]
            assert await at("bob") == []
            assert await at("") == []

    uvloop.run(inside())
