"""The files of an agent's machine, as its runner asks for them."""

import asyncio
import os
from pathlib import Path
from typing import Any

from topologies.system.machines.packing import pack, unpack
from wire.machine_channel import MOST_BODY_BYTES, Header


class AgentFiles:
    """The files of an agent; each is its owner's alone."""

    async def do_put(self, header: Header, body: bytes) -> tuple[Any, bytes]:
        """Go on with a file that is under way; with its last part it takes the place of `path`.

        Readers find all of it or the file before, also while it is put again.
        """
        under_way = Path(header["under_way"])
        append_private(under_way, body)
        if header["is_last"]:
            under_way.replace(header["path"])
        return None, b""

    async def do_get(self, header: Header, _body: bytes) -> tuple[Any, bytes]:
        path = Path(header["path"])
        if not path.exists():
            return False, b""
        with path.open("rb") as file:
            file.seek(header["offset"])
            return True, file.read(MOST_BODY_BYTES)

    async def do_folder(self, header: Header, _body: bytes) -> tuple[Any, bytes]:
        Path(header["path"]).mkdir(mode=0o700, parents=True, exist_ok=True)
        return None, b""

    async def do_pack(self, header: Header, _body: bytes) -> tuple[Any, bytes]:
        """Pack a folder into a file; pass over links and the like."""

        def work() -> None:
            path = Path(header["path"])
            path.unlink(missing_ok=True)
            append_private(path, pack(Path(header["folder"]), pass_over=True))

        return await asyncio.to_thread(work), b""

    async def do_unpack(self, header: Header, _body: bytes) -> tuple[Any, bytes]:
        def work() -> None:
            file = Path(header["path"])
            packed = file.read_bytes()
            file.unlink()
            unpack(packed, Path(header["folder"]))

        return await asyncio.to_thread(work), b""

    async def do_remove(self, header: Header, _body: bytes) -> tuple[Any, bytes]:
        Path(header["path"]).unlink()
        return None, b""


def append_private(path: Path, data: bytes) -> None:
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600), "wb") as file:
        file.write(data)
