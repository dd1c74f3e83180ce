"""NetQASM's bytes, as its SDK writes and reads them: the SDK is the independent program."""

import random

import pytest
from netqasm.backend import messages as sdk
from netqasm.lang.encoding import RegisterName
from netqasm.lang.instr.flavour import CORE_INSTRUCTIONS, VanillaFlavour
from netqasm.lang.operand import Address, ArrayEntry, ArraySlice, Immediate, Register
from netqasm.lang.parsing import parse_text_subroutine
from netqasm.lang.subroutine import Subroutine as SdkSubroutine

from applications.netqasm.text_format import (
    Greeting,
    decode_greeting,
    encode_greeting,
    encode_text,
    take_text,
)
from applications.processing_unit.messages import (
    Finished,
    InitApplication,
    OpenSocket,
    ReturnedArray,
    ReturnedRegister,
    StopApplication,
    StopUnit,
    decode_host_message,
    decode_unit_message,
    encode_host_message,
    encode_unit_message,
)
from applications.processing_unit.pair_requests import (
    Measuring,
    PairAnswer,
    PairRequest,
    PairsMade,
    RandomBasis,
    Use,
    Verdict,
    decode_answer,
    decode_made,
    decode_request,
)
from applications.processing_unit.subroutine import (
    INSTRUCTIONS,
    Subroutine,
    decode_subroutine,
    encode_subroutine,
)
from wire.malformed import MalformedPacket

EVERY = [*CORE_INSTRUCTIONS, *VanillaFlavour().instrs]
TEXT = """
# NETQASM 1.0
# APPID 7
set R3 -5
array 10 @2
store R3 @2[1]
bnz M0 4
rot_z Q0 3 4
wait_all @2[0:10]
ret_arr @2
"""


def numbers(operand: object) -> tuple[int, ...]:
    """Return an operand of the SDK as our numbers."""
    match operand:
        case Register():
            return (16 * "RCQM".index(operand.name.name) + operand.index,)
        case Immediate():
            return (operand.value,)
        case Address():
            return (operand.address,)
        case ArrayEntry():
            return *numbers(operand.address), *numbers(operand.index)
        case ArraySlice():
            return *numbers(operand.address), *numbers(operand.start), *numbers(operand.stop)
    raise TypeError(operand)


def drawn(kinds: str, name: str, draws: random.Random) -> list[object]:
    """Draw operands as the SDK has them; ours are in `kinds`."""

    def register() -> Register:
        return Register(draws.choice(list(RegisterName)), draws.randrange(16))

    def address() -> Address:
        return Address(draws.randrange(1 << 31))

    grouped = {
        "store": lambda: [register(), ArrayEntry(address(), register())],
        "load": lambda: [register(), ArrayEntry(address(), register())],
        "undef": lambda: [ArrayEntry(address(), register())],
        "wait_single": lambda: [ArrayEntry(address(), register())],
        "wait_all": lambda: [ArraySlice(address(), register(), register())],
        "wait_any": lambda: [ArraySlice(address(), register(), register())],
        "array": lambda: [register(), address()],
        "lea": lambda: [register(), address()],
        "ret_arr": lambda: [address()],
    }
    if name in grouped:
        return grouped[name]()
    made = {
        "r": register,
        "i": lambda: Immediate(draws.randrange(-(1 << 31), 1 << 31)),
        "b": lambda: Immediate(draws.randrange(256)),
    }
    return [made[kind]() for kind in kinds]  # type: ignore[no-untyped-call]


def test_every_instruction_of_the_vanilla_flavour_is_known_by_its_number_and_name() -> None:
    assert {(each.id, each.mnemonic) for each in EVERY} == {
        (number, name) for number, (name, _kinds) in INSTRUCTIONS.items()
    }


def test_instructions_that_the_sdk_writes_are_read() -> None:
    for kind in EVERY:
        draws = random.Random(1)
        name, kinds = INSTRUCTIONS[kind.id]
        for _ in range(50):
            operands = drawn(kinds, name, draws)
            instruction = kind.from_operands(operands)
            subroutine = SdkSubroutine(instructions=[instruction], app_id=7)
            subroutine.instantiate(7)
            data = bytes(subroutine)
            (read,) = decode_subroutine(data).instructions
            assert read.name == name
            assert read.operands == tuple(n for each in operands for n in numbers(each))
            assert encode_subroutine(Subroutine(7, (read,))) == data


def test_a_subroutine_is_read_and_told_as_people_write_it() -> None:
    data = bytes(parse_text_subroutine(TEXT))
    read = decode_subroutine(data)
    assert read.application == 7
    reports = [str(instruction) for instruction in read.instructions]
    assert "set R3 -5" in reports
    assert "rot_z Q0 3 4" in reports
    assert reports[-1] == "ret_arr 2"


def test_no_part_of_a_subroutine_is_one() -> None:
    data = bytes(parse_text_subroutine(TEXT))
    whole = {len(data) - 7 * missing for missing in range(len(data) // 7 + 1)}
    for length in set(range(len(data))) - whole:
        with pytest.raises(MalformedPacket):
            decode_subroutine(data[:length])


@pytest.mark.parametrize(
    "data",
    [
        bytes(4) + bytes([250, 0, 0, 0, 0, 0, 0]),  # no such instruction
        bytes(4) + bytes([1, 0b0100_0000, 0, 0, 0, 0, 0]),  # no such register
        bytes(4) + bytes([1, 0, 0, 0, 0, 0, 1]),  # something behind the operands
        bytes(4 + 7 * 100_001),
    ],
)
def test_what_is_no_netqasm_is_refused(data: bytes) -> None:
    with pytest.raises(MalformedPacket):
        decode_subroutine(data)


@pytest.mark.parametrize(
    ("theirs", "ours"),
    [
        (sdk.InitNewAppMessage(app_id=3, max_qubits=5), InitApplication(3, 5)),
        (
            sdk.OpenEPRSocketMessage(3, 1, remote_node_id=2, remote_epr_socket_id=4),
            OpenSocket(3, 1, 2, 4),
        ),
        (sdk.StopAppMessage(3), StopApplication(3)),
        (sdk.SignalMessage(sdk.Signal.STOP), StopUnit()),
    ],
)
def test_what_applications_say_is_read_and_no_part_of_it(theirs: object, ours: object) -> None:
    data = bytes(theirs)  # type: ignore[call-overload]
    assert decode_host_message(data) == ours
    assert encode_host_message(ours) == data
    for wrong in (*(data[:length] for length in range(len(data))), data + b"\0"):
        with pytest.raises(MalformedPacket):
            decode_host_message(wrong)


def test_the_sdk_reads_what_a_unit_says() -> None:
    done = sdk.deserialize_return_msg(encode_unit_message(Finished(9)))
    assert done.msg_id == 9
    register = sdk.deserialize_return_msg(encode_unit_message(ReturnedRegister(49, -3)))
    assert (register.register.register_name, register.register.register_index) == (3, 1)
    assert register.value == -3
    array = sdk.deserialize_return_msg(encode_unit_message(ReturnedArray(6, [1, -2, 3])))
    assert (array.address, array.values) == (6, [1, -2, 3])


@pytest.mark.parametrize(
    "message", [Finished(9), ReturnedRegister(49, -3), ReturnedArray(6, [1, None, -2])]
)
def test_what_a_unit_says_comes_back_and_no_part_of_it(message: object) -> None:
    data = encode_unit_message(message)  # type: ignore[arg-type]
    assert decode_unit_message(data) == message
    for length in range(len(data)):
        with pytest.raises(MalformedPacket):
            decode_unit_message(data[:length])


def test_a_request_for_pairs_has_these_bytes() -> None:
    request = PairRequest(
        "alice", 1, 2, 300, Use.MEASURE, Measuring(RandomBasis.XZ, (24, 0, 8), axes=2)
    )
    data = (
        b"QE\x02" + b"alice".ljust(32, b"\0") + bytes.fromhex("00000001 00000002 0000012c")
        + bytes([1, 1, 24, 0, 8, 2])
    )  # fmt: skip
    assert request.encode() == data
    assert decode_request(data) == request
    wrong = [data[:length] for length in range(len(data))]
    wrong += [b"XX" + data[2:], data[:-6] + bytes([3]) + data[-5:], data[:-1] + bytes([3])]
    for each in wrong:
        with pytest.raises(MalformedPacket):
            decode_request(each)


def test_answers_to_requests_for_pairs() -> None:
    data = bytes.fromhex("5145 02 00 c000 0000012c")
    assert PairAnswer(Verdict.READY, 49_152, 300).encode() == data
    assert decode_answer(data) == (Verdict.READY, 49_152, 300)
    refusal = bytes.fromhex("5145 02 02 0000 00000000")
    assert PairAnswer(Verdict.OTHER_USE).encode() == refusal
    assert decode_answer(refusal).verdict == Verdict.OTHER_USE
    wrong_fields = ["02 09 c000 00000001", "01 00 c000 00000001", "02 00 c000 00000000"]
    wrong_fields += ["02 00 c000 00001001", "02 01 0000 00000001"]
    for wrong in map(bytes.fromhex, wrong_fields):
        with pytest.raises(MalformedPacket):
            decode_answer(b"QE" + wrong)
    for wrong in (*(data[:length] for length in range(len(data))), data + b"\0"):
        with pytest.raises(MalformedPacket):
            decode_answer(wrong)


def test_the_light_of_pairs_that_are_made_has_these_bytes() -> None:
    data = bytes.fromhex("5145 02 0000012c")
    assert PairsMade(300).encode() == data
    assert decode_made(data) == PairsMade(300)
    for wrong in (*(data[:length] for length in range(len(data))), data[:-4] + b"\x80\0\0\0"):
        with pytest.raises(MalformedPacket):
            decode_made(wrong)


def test_greetings_and_texts_come_back_and_nothing_else_does() -> None:
    greeting = Greeting("bob", "alice", 3)
    data = encode_greeting(greeting)
    assert data == b"QT\x01" + bytes([0, 0, 0, 3]) + b"bob".ljust(32, b"\0") + b"alice".ljust(
        32, b"\0"
    )
    assert decode_greeting(data) == greeting
    for wrong in (data[:-1], b"XX" + data[2:], data[:10] + b"\xff" + data[11:]):
        with pytest.raises(MalformedPacket):
            decode_greeting(wrong)
    coming = bytearray(encode_text("é") + encode_text("") + b"\0\0")
    assert coming.startswith(bytes.fromhex("00000002 c3a9"))
    assert [take_text(coming), take_text(coming), take_text(coming)] == ["é", "", None]
    for bad in (b"\xff\xff\xff\xff", b"\0\0\0\1\xff"):
        with pytest.raises(MalformedPacket):
            take_text(bytearray(bad))
