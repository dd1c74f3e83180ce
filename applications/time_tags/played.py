"""Tags of measured light, played into a host in place of what its detectors see.

A topology says so, by `play`. Time is cut into slots, from the first tag on; they are the places of
the simulated pairs, in their order. A host detects in a slot the outcome of its only tag there, if
that is of the basis that the host has chosen for the slot. Half of the tags are of the other one.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from mininet.topo import Topo
from numpy.typing import NDArray

from applications.time_tags import words
from hosts.hardware.block_name import BlockName
from hosts.hardware.replies import Clicks, HardwareError
from hosts.hardware.simulated import SimulatedQnic
from wire.dispatcher_pb2 import Feedback, Step
from wire.keyed import KeyedChoices
from wire.malformed import MalformedPacket
from wire.parameters.physics import BadParameter

CHANNELS = np.full(1 << words.PATTERN_BITS, 255, np.uint8)  # by pattern; others are of several
CHANNELS[[1, 4, 2, 8]] = range(4)
MOST_BYTES = 1 << 28
NAME = "played"  # among the hardware that packages register
NOT_AHEAD: Mapping[str, int] = MappingProxyType({})


class Tags:
    """The only tag of each slot, if there is one."""

    def __init__(self, units: words.Units, patterns: words.Patterns, slot_units: int) -> None:
        slots = units // slot_units
        alone = np.ones(slots.size, bool)
        alone[1:] &= np.diff(slots) > 0
        alone[:-1] &= np.diff(slots) > 0
        alone &= (slots >= 0) & (CHANNELS[patterns] < CHANNELS.max())
        self._slots, self._channels = slots[alone], CHANNELS[patterns[alone]]

    def within(self, first: int, slots: int) -> tuple[NDArray[np.int64], NDArray[np.uint8]]:
        """Return the places of tags among these slots, and their channels."""
        begin, end = self._slots.searchsorted([first, first + slots])
        return self._slots[begin:end] - first, self._channels[begin:end]


def read(path: Path) -> tuple[words.Units, words.Patterns]:
    """Return a file's tags; raise BadParameter for one that cannot be played."""
    try:
        if path.exists() and not path.is_file():
            raise BadParameter(f"{path} is not a file: name one of tags")
        with path.open("rb") as file:
            data = file.read(MOST_BYTES + 1)
        if len(data) > MOST_BYTES:
            raise BadParameter(f"{path} has more than {MOST_BYTES} bytes: cut it")
        units, patterns = words.decode(data)
    except (OSError, MalformedPacket) as error:
        raise BadParameter(f"{path} has no tags to play: {error}") from error
    if not units.size:
        raise BadParameter(f"{path} has no tags to play: it is empty")
    return units, patterns


class PlayedQnic(SimulatedQnic):
    """A host's card that plays tags, its times from `begin_units` on."""

    def __init__(self, *made_with: Any, file: str, begin_units: int, slot_units: int) -> None:
        super().__init__(*made_with)
        units, patterns = read(Path(file))
        self._tags = Tags(units - begin_units, patterns, slot_units)
        self._next: defaultdict[int, int] = defaultdict(int)  # slot, by session

    async def perform(self, *order: Step) -> list[Feedback]:
        _refuse_others(order)
        return await super().perform(*order)

    async def perform_repeatedly(self, session: int, number: int, *order: Step) -> list[Feedback]:
        _refuse_others(order)
        return await super().perform_repeatedly(session, number, *order)

    async def discard(self, session: int) -> None:
        self._next.pop(session, None)
        await super().discard(session)

    async def click_arrivals(
        self, block: BlockName, port: str, key: bytes, timeout_s: float
    ) -> Clicks:
        """Wait for light, and report the tags of its slots."""
        light = await super().click_arrivals(block, port, key, timeout_s)
        first = self._next[block.session]
        self._next[block.session] += light.photons
        at, channels = self._tags.within(first, light.photons)
        chosen = channels >> 1 == KeyedChoices(key, light.photons).bases(at)
        return Clicks(light.photons, at[chosen], channels[chosen] & 1)


def _refuse_others(order: Sequence[Step]) -> None:
    """Raise HardwareError for a measurement that tags do not take the place of."""
    for step in order:
        kind = step.WhichOneof("operation")
        if kind in ("bell_measure", "resend") or (kind == "measure" and not step.measure.key):
            raise HardwareError(
                "tags are played for keys of --protocol bbm92 alone: choose it, or leave play out"
            )


def play(
    topo: Topo, files: Mapping[str, str], slot_ps: int, ahead_ps: Mapping[str, int] = NOT_AHEAD
) -> None:
    """Let hosts of a topology play files, whose clocks are ahead of the others' by so much.

    Raise BadParameter for a file that cannot be played, and for times of no whole units.
    """
    if slot_ps < words.UNIT_PS:
        raise BadParameter(f"slot_ps {slot_ps}: choose {words.UNIT_PS} or more")
    slot_units = _units("slot_ps", slot_ps)
    ahead = {host: _units(f"ahead_ps of {host}", ahead_ps.get(host, 0)) for host in files}
    begins = [int(read(Path(file))[0][0]) - ahead[host] for host, file in files.items()]
    begin = min(begins)
    if max(begins) - begin > words.WRAP // 2:
        raise BadParameter(
            "the first tags of these files are more than 9.7 hours apart, or times begin again "
            "between them: cut the files"
        )
    for host, file in files.items():
        topo.nodeInfo(host)["qnic"] = NAME
        topo.nodeInfo(host)["qnic_parameters"] = {
            "file": str(Path(file).resolve()),
            "begin_units": begin + ahead[host],
            "slot_units": slot_units,
        }


def _units(name: str, time_ps: int) -> int:
    if time_ps % words.UNIT_PS:
        raise BadParameter(f"{name} {time_ps}: choose a multiple of {words.UNIT_PS}")
    return time_ps // words.UNIT_PS
