"""Generates the protocol modules of wire/ for a wheel or an sdist, by grpcio-tools."""

from pathlib import Path
from typing import Any

from grpc_tools import protoc
from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class Protocols(BuildHookInterface):
    PLUGIN_NAME = "custom"

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        root = Path(self.root)
        for proto in sorted(root.glob("wire/*.proto")):
            outputs = ("--python_out", "--pyi_out", "--grpc_python_out")
            words = ["protoc", f"-I{root}", *(f"{name}={root}" for name in outputs), str(proto)]
            if protoc.main(words):
                raise RuntimeError(f"protoc refused {proto}: its words are above")
