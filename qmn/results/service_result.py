"""The part of a result that a job adds: the last figures of both ends, and bytes they moved."""

from collections.abc import Collection, Mapping
from hashlib import file_digest
from pathlib import Path
from typing import Any

from wire.device import setting_name
from wire.results.figures import Figures, SentFigures
from wire.results.run_result import Job, Message, NetqasmJob, ServiceJob

RECEIVED = "received"  # in the folder of the run
UNITS = {"_per_s": "/s", "_ms": " (ms)", "_s": " (s)", "_rad": " (rad)", "_db": " (dB)"}
NAMES = {
    "assumed": "assumption",
    "compared": "pairs compared",
    "elapsed_s": "duration (s)",
    "emitted": "pairs made",
    "fidelity_age_s": "age of the sample (s)",
    "fidelity_expected": "fidelity at delivery, expected",
    "max_qber": "no key above QBER",
    "multi_photon": "pulses of several photons",
    "net_key_bits": "key bits less authentication",
    "ones_fraction": "fraction of ones",
    "rounds": "rounds of purification",
    "sampled": "pairs sampled",
    "sampled_waited_ms": "wait of sampled halves (ms)",
    "shared": "pairs shared",
    "survived": "pairs purified",
    "waited_ms": "wait in memories (ms)",
}
# Counts of what few sessions do, and names for programs: not printed if 0, or at all.
RARE = frozenset({"attempts", "compared", "dropped", "multi_photon", "rounds", "survived"})
FOR_PROGRAMS = frozenset({"session", "first_key_id", "last_key_id"})


def message(file: str, folder: Path) -> Message:
    """Return what a run has made of a file: the digests of what was sent and of what came."""
    sent = Path(file)
    return Message(file, sent.stat().st_size, sha256(sent), sha256(folder / RECEIVED))


def sha256(file: Path) -> str | None:
    """Return the digest of a file, None if there is none."""
    if not file.exists():
        return None
    with file.open("rb") as opened:
        return file_digest(opened, "sha256").hexdigest()


def rows(job: Job) -> dict[str, str]:
    if isinstance(job, NetqasmJob):
        return {}
    figures = vars(job.asking)
    printed = [
        name
        for name, value in figures.items()
        if name not in FOR_PROGRAMS and (value or name not in RARE)
    ]
    texts = _sent(job.asking) if isinstance(job.asking, SentFigures) else {}
    texts = texts or number_rows(job.asking, printed)
    if (figures.get("net_key_bits") or 0) < 0:
        texts[label("net_key_bits")] += " (authentication has used more keys than it was given)"
    if isinstance(job, ServiceJob) and job.message is not None:
        outcome = "delivered exactly" if job.message.arrived else "NOT DELIVERED"
        texts = {"message": f"{job.message.bytes:,} bytes, {outcome}", **texts}
    return texts


def number_rows(figures: Figures, names: Collection[str]) -> dict[str, str]:
    """Return those figures that have these names as text, each with its error or interval."""
    values = vars(figures)
    bounds = {f"{name}_{end}" for name in values for end in ("low", "high", "error")}
    return {
        label(name): number_text(value) + _bounds(values, name)
        for name, value in values.items()
        if name in names and name not in bounds
    }


def label(name: str) -> str:
    """Return the words for the field of a figure, with its unit."""
    if name in NAMES:
        return NAMES[name]
    for suffix, unit in UNITS.items():
        if name.endswith(suffix):
            name = name.removesuffix(suffix) + unit
            break
    return name.replace("_", " ").replace("qber", "QBER")


def _bounds(values: Mapping[str, Any], name: str) -> str:
    low, high, error = (values.get(f"{name}_{end}") for end in ("low", "high", "error"))
    if error is not None:
        return f" ± {error:.1g}"
    return "" if low is None or high is None else f" ({number_text(low)} to {number_text(high)})"


def _sent(figures: SentFigures) -> dict[str, str]:
    rate = figures.symbol_error_rate
    return {
        "Bell pairs used": f"{figures.bell_pairs:,}",
        "pairs lost": f"{figures.lost_pairs:,}",
        "symbol error rate": "no symbol received" if rate is None else f"{rate:.4g}",
        **coding(figures),
        "repeated frames": f"{figures.repeated_frames:,}",
        "pairs/s": f"{figures.pairs_per_s:,.0f} ({figures.elapsed_s:.2f} s)",
    }


def coding(figures: SentFigures) -> dict[str, str]:
    """Return the lines about the error-correction code; none if there was no code."""
    if not figures.fec:
        return {}
    order = "interleaved" if figures.interleave else "not interleaved"
    return {
        "code": f"{setting_name('fec', figures.fec)}, {order}, rate {figures.code_rate:.3f}",
        "put right by it": f"{figures.corrected_symbols:,} wrong symbols, "
        f"{figures.filled_symbols:,} lost ones",
    }


def number_text(value: Any) -> str:
    if value is None:
        return "not known"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:,.4g}" if abs(value) < 10_000 else f"{value:,.0f}"
    return f"{value:,}" if isinstance(value, int) else str(value)
