"""The sentence about a run: its result, with the numbers that matter."""

from qmn.results.run_result import RunResult
from qmn.results.titles import TITLES
from wire.results.figures import (
    EveFigures,
    KeyFigures,
    LoadFigures,
    PairFigures,
    SealFigures,
    SentFigures,
    StoredKeyFigures,
    TeleportFigures,
    TunnelFigures,
)
from wire.results.run_result import NetqasmJob, ServiceJob

IN_BOTH_BASES = frozenset({"bb84", "bbm92", "e91"})  # bits of key are of Z and X, half of each
NORMAL_95 = 1.96  # standard errors to either side


def sentence(result: RunResult) -> str:
    """Return the result of the run in words."""
    text = _of_keys(result) if isinstance(result.asking, KeyFigures) else ""
    if result.message is not None:
        text = _of_message(result)
    if text:
        return text
    title = TITLES.get(result.service, result.service)
    if not result.delivered:
        return f"{title}: {result.error or 'not done'}"
    if isinstance(result.job, NetqasmJob):
        where = ", ".join(f"{role} on {host}" for role, host in result.job.roles.items())
        rounds = len(result.job.outputs)
        return f"{rounds:,} round{'s' * (rounds != 1)} done: {where}"
    return _of_states(result) or f"{title}: done"


def of_eve(result: RunResult) -> str:
    """Return what an eavesdropper took and knows; "" if there was none.

    Half of her bases are right; from the others half of the bits come out wrong.
    """
    eve = result.job.eve if isinstance(result.job, ServiceJob) else None
    if not isinstance(eve, EveFigures) or not eve.photons:
        return ""
    if not eve.measured:
        return f"Eve kept a photon of {eve.multi_photon:,} of {eve.photons:,} pulses."
    share = 100 * eve.measured / eve.photons
    text = f"Eve measured {eve.measured:,} of {eve.photons:,} photons ({share:.1f} %) and sent on "
    if result.service not in IN_BOTH_BASES:
        return f"{text}the outcomes."
    knowledge = f"she knows {share / 2:.1f} % of the sifted bits, and makes {share / 4:.1f} %"
    return f"{text}the outcomes: {knowledge} of them wrong."


def interval(value: float, low: float, high: float) -> str:
    digits = 4 if high - low < 0.01 else 3
    return f"{value:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


def _of_message(result: RunResult) -> str:
    sent, receiver = result.asking, result.hosts[-1]
    number = result.message.bytes if result.message else 0
    if not result.delivered:
        return f"NOT DELIVERED: {number:,} bytes to {receiver}"
    text = f"delivered exactly: {number:,} bytes to {receiver}"
    if isinstance(sent, SentFigures) and sent.symbol_error_rate is not None:
        wrong = f"{100 * sent.symbol_error_rate:.3g} %"
        text += f" in {sent.bell_pairs:,} Bell pairs, {wrong} of symbols wrong before correction"
    return text


def _of_keys(result: RunResult) -> str:
    keys = result.asking
    assert isinstance(keys, KeyFigures)
    if keys.qber is None or keys.qber_low is None or keys.qber_high is None:
        return ""
    digits = 0 if keys.qber_high - keys.qber_low > 0.1 else 1
    low, high = (f"{100 * end:.{digits}f}" for end in (keys.qber_low, keys.qber_high))
    rate = f"QBER {100 * keys.qber:.1f} % ({low} to {high} %)"
    if result.delivered:
        return f"{keys.key_bits:,} bits of secret key, {rate}"
    if keys.max_qber is not None and keys.qber > keys.max_qber:
        return f"No key: an eavesdropper or noise, {rate}"
    return f"No key: {(result.error or '').removeprefix('no key: ')}"


def _of_states(result: RunResult) -> str:
    """Return the sentence of states or pairs that hosts share; "" for other jobs."""
    begin, end = result.hosts[0], result.hosts[-1]
    match result.asking:
        case TeleportFigures(fidelity=float(fidelity), fidelity_error=float(error)) as found:
            text = f"{found.arrived:,} of {found.states:,} states of {begin} arrived at {end}"
            return f"{text}, with fidelity {_fidelity(fidelity, error)}"
        case PairFigures() as found:
            text = f"{found.pairs:,} pairs of {begin} and {end}"
            if found.fidelity is None or found.fidelity_low is None or found.fidelity_high is None:
                return text
            between = interval(found.fidelity, found.fidelity_low, found.fidelity_high)
            return f"{text}, with fidelity {between}"
        case SealFigures() as found:
            verdict = "Alarm: somebody measures" if found.alarm else "No alarm"
            return f"{verdict}, {found.compared:,} pairs of {begin} and {end} compared"
        case LoadFigures() as found:
            return f"{found.accepted:,} of {found.sessions:,} sessions had light"
        case TunnelFigures() as found:
            file = "the file arrived intact" if found.file_intact else "the file is not whole"
            return f"{file}, {found.received_bytes:,} bytes under {found.keys_used:,} keys"
        case StoredKeyFigures() as found:
            text = f"{found.keys:,} keys of {begin} and {end} in {found.sessions:,} sessions"
            return f"{text}, {found.sessions_without_key:,} of them without a key"
    match vars(result.asking):  # of a line of hosts, whichever service it is
        case {"states": states, "hosts": hosts, "fidelity": float(mean), "fidelity_error": error}:
            return f"{states:,} states of {hosts} hosts, with fidelity {_fidelity(mean, error)}"
        case {"states": states, "hosts": hosts, "fidelity_at_least": float(least)}:
            return f"{states:,} states of {hosts} hosts, with fidelity at least {least:.3f}"
        case {"key_bits": bits, "hosts": hosts, "qber_x": x, "qber_z": [*z]}:
            rates = f"QBER {100 * x:.1f} % in X, at most {100 * max(z):.1f} % in Z"
            return f"{bits:,} bits of secret key of {hosts} hosts, {rates}"
        case {"hosts": hosts, "sum_rad": float(phases), "sum_error_rad": float(error)}:
            most = NORMAL_95 * error
            total = interval(phases, phases - most, phases + most)
            return f"The phases at {hosts} hosts add up to {total} rad"
    return ""


def _fidelity(mean: float, error: float) -> str:
    most = NORMAL_95 * error
    return interval(mean, max(mean - most, 0.0), min(mean + most, 1.0))
