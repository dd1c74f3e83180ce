"""The part of a result that a job adds: the last figures of both ends, and bytes they moved."""

from hashlib import file_digest
from pathlib import Path
from typing import Any

from wire.device import setting_name
from wire.results.figures import Figures, SentFigures
from wire.results.run_result import Job, Message, NetqasmJob, ServiceJob

RECEIVED = "received"  # in the folder of the run


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
    texts = _sent(job.asking) if isinstance(job.asking, SentFigures) else _plain(job.asking)
    if (vars(job.asking).get("net_key_bits") or 0) < 0:
        texts["net key bits"] += " (its session has used more of older keys than it has made)"
    if not isinstance(job, ServiceJob):
        return texts
    if job.message is not None:
        outcome = "delivered exactly" if job.message.arrived else "NOT DELIVERED"
        texts = {"message": f"{job.message.bytes:,} bytes, {outcome}", **texts}
    eve = _plain(job.eve) if job.eve is not None else {}
    return texts | {f"eve: {name}": value for name, value in eve.items()}


def _plain(figures: Figures) -> dict[str, str]:
    return {name.replace("_", " "): number_text(value) for name, value in vars(figures).items()}


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
