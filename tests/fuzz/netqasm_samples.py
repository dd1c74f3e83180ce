"""Messages of NetQASM as its SDK writes them, and a capture as scapy writes it."""

import io
from typing import Any

from netqasm.backend import messages as sdk
from netqasm.lang.parsing import parse_text_subroutine
from scapy.layers.inet import IP as IP
from scapy.layers.inet import TCP as TCP
from scapy.layers.l2 import Ether as Ether
from scapy.utils import PcapWriter
from test_netqasm import TEXT

from applications.processing_unit.messages import (
    Finished,
    ReturnedArray,
    ReturnedRegister,
    encode_unit_message,
)
from applications.processing_unit.pair_requests import Measuring, PairRequest, RandomBasis, Use

SUBROUTINES = [bytes(parse_text_subroutine(TEXT))]
HOST_MESSAGES = [
    bytes(sdk.InitNewAppMessage(app_id=7, max_qubits=5)),
    bytes(sdk.OpenEPRSocketMessage(7, 1, 2, 3, 100)),
    bytes(sdk.StopAppMessage(app_id=7)),
    bytes(sdk.SignalMessage(signal=sdk.Signal.STOP)),
    *(bytes([2]) + each for each in SUBROUTINES),
]
UNIT_MESSAGES = [
    encode_unit_message(each)
    for each in (ReturnedArray(2, [1, None, -3]), ReturnedRegister(17, -5), Finished(4))
]
PAIRS = PairRequest("alice", 1, 2, 10, Use.MEASURE, Measuring(RandomBasis.XZ, (1, 2, 3), 1))


def pcap(frame: bytes) -> bytes:
    """Return a capture of three frames."""
    file: Any = io.BytesIO()
    writer = PcapWriter(file, sync=True, nano=True)
    for _ in range(3):
        writer.write(frame)
    return bytes(file.getvalue())
