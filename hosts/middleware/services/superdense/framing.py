"""Frames, checks and repeats, at both ends: see outbox.py and inbox.py; here is what both share.

The sender cuts bytes into frames and fills blocks of pairs: first the symbols that the
receiver asked for again (refills), then new frames. Where most light is lost, a block has more
refills than there are open symbols, and carries these in turn, again and again; the first copy that
comes counts. The receiver tries a frame as soon as none of its symbols is on its way any more, with
its losses as erasures. If the check fails, lost pairs are asked for again one by one: they are few,
and each one filled leaves the code more room for errors. A frame that has nothing lost and still
fails is repeated as a whole.
Blocks of new frames alone may be sent before a report of those before them has come; refills wait
for all reports. Both ends keep the same ascending list of open slots, slot = frame number * pairs
of a full frame + index, so the list itself never travels.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hosts.middleware.services.superdense.frame_format import FrameFormat
from wire.metadata.blocks import Frame

Slots = NDArray[np.int64]
BLOCKS_UNDER_WAY = 4  # at most: sent, and not reported of
NO_SLOTS: Slots = np.empty(0, dtype=np.int64)


class FramingError(Exception):
    """The two ends do not agree on what was sent: a fault of the other side."""


@dataclass(frozen=True)
class SlotMap:
    """Where frames lie in the ascending numbers of their symbols; the same at both ends."""

    format: FrameFormat
    frame_bytes: int

    @property
    def frame_pairs(self) -> int:
        return self.format.pairs(self.frame_bytes)

    def frame(self, number: int, size: int) -> Slots:
        first = number * self.frame_pairs
        return np.arange(first, first + self.format.pairs(size), dtype=np.int64)

    def block(self, open_slots: Slots, refills: int, frames: tuple[Frame, ...]) -> Slots:
        """Return the slot of each pair of a block: open ones in turn, then those of new frames."""
        new = [self.frame(frame.number, frame.size) for frame in frames]
        return np.concatenate([np.resize(open_slots, refills), *new])

    def numbers(self, slots: Slots) -> Slots:
        return np.unique(slots // self.frame_pairs)

    def runs(self, slots: Slots) -> tuple[list[int], Slots, Slots]:
        """Return the frame numbers of slots, where each begins, and the indices inside frames.

        Slots of a block are runs of one frame each: refills ascend, perhaps several times, new
        frames follow.
        """
        frames, indices = np.divmod(slots, self.frame_pairs)
        starts = np.flatnonzero(np.diff(frames, prepend=-1))
        return frames[starts].tolist(), starts, indices
