"""Gathers photons of a node's blocks into a new block, in a new order.

    block 0/0   0 1 2 3 4 5          into block 1/0   4 0 3
                                     and block 2/0    5 2 1

Nothing happens to the photons: a host only numbers them again. The rest of the blocks is
discarded if it is not to be kept.
"""

from collections.abc import Sequence
from functools import partial
from hashlib import blake2b
from typing import NamedTuple

import grpc
import numpy as np
from numpy.typing import NDArray

from dispatcher.approximations import EXACT, UNLIKE_LIGHT, Approximations, approximation
from dispatcher.layer import cutoff, drift, extra_pairs, herald, pulses
from dispatcher.layer.layer import PhysicalLayer, block_name
from dispatcher.layer.ownership import Block, BlockName
from dispatcher.operations import limits, weak_light
from dispatcher.refusal import Refusal, exhausted, invalid
from dispatcher.sabot.limits import require_count, require_positions
from dispatcher.sabot.registers import Mask
from dispatcher.sabot.registers import Pick as RegisterPick
from wire.dispatcher_pb2 import Feedback, GatherRequest, Pick
from wire.positions import unpack

MOST_PLACES = 2  # for each qubit that may live
MOST_NAMED = 8  # blocks that an event names


class Picked(NamedTuple):
    """Photons of a block, counted from 0, in the order in which they are wanted."""

    block: Block
    positions: NDArray[np.uint32]


class Gathering:
    def __init__(self, layer: PhysicalLayer) -> None:
        self._layer = layer

    def gather(self, node: str, request: GatherRequest) -> Feedback:
        """Make a block of the photons that are picked; keep or discard the rest."""
        layer, into, keep_rest = self._layer, block_name(request.into), request.keep_rest
        picked = self._look_up(node, request.picks)
        blocks = [block for block, _positions in picked]
        self._require_free(node, into, [] if keep_rest else blocks)
        if keep_rest:
            require_places(layer, node, sum(positions.size for _block, positions in picked))
        stored = self._take_up(blocks)
        gathered = self._block(node, into, picked)
        if keep_rest:
            for block, positions in picked:
                taken = _mask(positions, block.register.size)
                extra_pairs.darken(layer.sabot, block, taken)
                herald.drop(block, taken)
        else:
            for block in blocks:
                layer.drop(block)
        if stored:
            layer.memories.exchange(blocks if keep_rest else [], gathered)
        layer.ownership.add(gathered)
        left = any(positions.size < block.register.size for block, positions in picked)
        detail = _description(picked) + (", still stored" if stored else "")
        detail += ", the rest let go" if left and not keep_rest else ""
        layer.record(node, "gather", gathered, detail=detail, each=partial(_origin, picked))
        return layer.feedback(gathered)

    def fill_gaps(self, block: Block, size: int) -> Block:
        """Return a stored block's first photons as a block of their own, which takes its place."""
        positions = np.flatnonzero(block.register.present)[:size].astype(np.uint32)
        came_ns, layer = cutoff.came_ns(block), self._layer
        filled = self._block(block.node, block.name, [Picked(block, positions)])
        filled.port, filled.maker = block.port, block.maker
        filled.interval_ns, filled.came_ns = block.interval_ns, came_ns[positions]
        filled.waited_ns = block.waited_ns
        layer.ownership.add(filled)
        layer.drop(block)
        layer.memories.exchange([], filled)
        return filled

    def _look_up(self, node: str, picks: Sequence[Pick]) -> list[Picked]:
        limits.require_picks(len(picks))
        picked: dict[BlockName, Picked] = {}
        for pick in picks:
            name = block_name(pick.block)
            if name in picked:
                raise invalid(f"{name} is picked from twice; pick all of it at once")
            block = weak_light.require(self._layer, name, node)
            field = f"photons of {name}"
            try:
                positions = unpack(pick.photons)
            except ValueError as error:
                raise invalid(f"{field}: {error}") from error
            require_positions(field, positions, block.register.size)
            picked[name] = Picked(block, positions)
        count = sum(positions.size for _block, positions in picked.values())
        if not count:
            raise invalid("no photons are picked; name at least one, or discard the blocks")
        require_count(count)
        return list(picked.values())

    def _require_free(self, node: str, into: BlockName, leaving: Sequence[Block]) -> None:
        """Refuse a name that is taken by photons which do not leave."""
        if self._layer.ownership.taken(into, node, leaving):
            message = f"{into} exists, here or elsewhere; discard it or take another number"
            raise Refusal(grpc.StatusCode.ALREADY_EXISTS, message)

    def _take_up(self, blocks: Sequence[Block]) -> bool:
        """Decide what waiting has done to stored blocks; return whether all of them stay stored."""
        layer = self._layer
        stored = [block for block in blocks if layer.memories.holds(block)]
        waits = [layer.memories.look_in(block) for block in stored]
        for block, detail in zip(stored, waits, strict=True):
            layer.record(block.node, "wait", block, detail=detail)
        if len(stored) == len(blocks):
            return True
        layer.take_up(*blocks)
        return False

    def _block(self, node: str, into: BlockName, picked: Sequence[Picked]) -> Block:
        blocks = [block for block, _positions in picked]
        for block in blocks:
            drift.twirl_turn(block, self._layer.sabot, self._layer.draws)
        light = pulses.gather([(block.pulses, positions) for block, positions in picked])
        light.approximations |= _unlike(blocks)
        more = extra_pairs.gather(self._layer.sabot, picked)
        picks = [RegisterPick(block.register, positions) for block, positions in picked]
        return Block(
            into,
            self._layer.sabot.gather(picks),
            node,
            first_ns=min(block.first_ns for block in blocks),
            last_ns=max(block.last_ns for block in blocks),
            fibers_passed=max(block.fibers_passed for block in blocks),
            pulses=light,
            extra_pairs=more,
            path_ps=max(block.path_ps for block in blocks),
            retimed=any(block.retimed for block in blocks),
            start_ns=max(block.start_ns for block in blocks),
            source_rate_hz=min(block.source_rate_hz for block in blocks),
            stores=max(block.stores for block in blocks),
            resends=max(block.resends for block in blocks),
            lineage=_lineage(picked),
            cutoff_s=min(block.cutoff_s for block in blocks),
            born_ns=cutoff.gather(picked),
            false_heralds=herald.gather(picked),
            kept=all(block.kept for block in blocks),
        )


def require_places(layer: PhysicalLayer, node: str, more: int) -> None:
    """Refuse to divide blocks again and again, of which little but their places is left."""
    limits.require_blocks(layer, 1, node)
    most = MOST_PLACES * layer.max_live_qubits
    if layer.ownership.places + more > most:
        raise exhausted(
            f"{more} more places for photons with {layer.ownership.places}, those of lost "
            f"ones included, exceed the limit of {most}; discard what little is left in"
        )


def _unlike(blocks: Sequence[Block]) -> Approximations:
    """Return what one spectrum and way for all may get wrong: any phase that interference shows."""
    kinds = set()
    for block in blocks:  # a memory keeps width and colour alone
        dispersion = 0.0 if block.kept else block.pulses.dispersion_ps_per_nm
        spectrum = block.pulses.spectrum._replace(dispersion_ps_per_nm=dispersion)
        kinds.add((spectrum, 0.0 if block.kept or block.retimed else block.path_ps))
    return approximation(UNLIKE_LIGHT, 0.5) if len(kinds) > 1 else EXACT


def _lineage(picked: Sequence[Picked]) -> str:
    """Return what only these photons in this order have: no two blocks draw the same numbers."""
    digest = blake2b(digest_size=16)
    for block, positions in picked:
        digest.update(f"{tuple(block.name)} {block.lineage} {positions.size} ".encode())
        digest.update(positions.tobytes())
    return digest.hexdigest()


def _mask(positions: NDArray[np.uint32], size: int) -> Mask:
    mask = np.zeros(size, dtype=bool)
    mask[positions] = True
    return mask


def _description(picked: Sequence[Picked]) -> str:
    parts = [
        f"{positions.size} of {block.register.size} of {_short(block)}"
        for block, positions in picked[:MOST_NAMED]
    ]
    if len(picked) > MOST_NAMED:
        parts.append(f"and of {len(picked) - MOST_NAMED} more blocks")
    return ", ".join(parts)


def _origin(picked: Sequence[Picked], photon: int) -> str:
    """Return where a photon comes from, counted from 1 as in the events of single photons."""
    for block, positions in picked:
        if photon < positions.size:
            return f"photon {positions[photon] + 1} of {_short(block)}"
        photon -= positions.size
    raise IndexError(photon)


def _short(block: Block) -> str:
    return f"{block.name.number}/{block.name.half}"
