"""The summary of conference key agreement: counts and error rates, never a key."""

from uuid import UUID

from hosts.middleware.qkd.conference import Leader, asymptotic_rate
from hosts.middleware.qkd.key_store import KEY_BITS
from wire.qkd import Bound
from wire.results.figures import ConferenceFigures

MEANING = {
    Bound.FINITE: "secret but for eps_sec, for hosts of the line that all are honest and detectors "
    "that miss as much in X as in Z",
    Bound.ASYMPTOTIC: "of endless keys: of a key of this length nothing is proven",
}


def summary(
    key: Leader, length: int, ids: list[UUID], elapsed_s: float, made: int, emitted: int
) -> ConferenceFigures:
    raw, others = key.raw.size, len(key.terms.names) - 1
    authentication = key.consumed_bits
    return ConferenceFigures(
        states=key.states,
        hosts=1 + others,
        raw_bits=raw,
        tests_in_x=key.in_x.sample,
        qber_x=key.in_x.qber,
        tests_in_z=key.worst.sample,
        qber_z=[found.qber for found in key.in_z],
        leaked_bits=key.leaked_bits,
        key_bits=length,
        key_fraction=length / raw,
        key_fraction_limit=asymptotic_rate(key.in_x.qber, key.worst.qber),
        bound=key.terms.bound.name.lower(),
        assumed=MEANING[key.terms.bound],
        keys=len(ids),
        bits_of_a_key=KEY_BITS,
        first_key_id=str(ids[0]) if ids else None,
        last_key_id=str(ids[-1]) if ids else None,
        authentication_bits=authentication,
        net_key_bits=length - authentication,
        states_per_s=key.states / elapsed_s,
        key_bits_per_s=length / elapsed_s,
        elapsed_s=elapsed_s,
        made=made,
        emitted=emitted,
    )
