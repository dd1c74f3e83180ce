"""The seed of each point, so that points are independent and a larger grid repeats the smaller."""

import json
from hashlib import blake2b

from qmn.sweeps.parameters import Values


def point_seed(experiment: str, values: Values, seed: int) -> int:
    """Return the seed of one point of an experiment, 63 bits."""
    text = json.dumps([experiment, sorted(values.items()), seed])
    return int.from_bytes(blake2b(text.encode(), digest_size=8).digest()) >> 1
