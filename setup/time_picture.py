"""Draws docs/time.png: fidelity over T2, stepped and paced, while other programs compute.

`python setup/time_picture.py`, as root: some four minutes.
"""

import json
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from matplotlib import pyplot as plt

ROOT = Path(__file__).parent.parent
STATES, RATE_HZ, KM, LIGHT_M_PER_S = 2_000, 50_000_000, 20.0, 2.04e8
T2_S = (0.002, 0.01, 0.05)
LOADS = {0: "o", 2: "s", 8: "^"}  # programs that compute, and how they are marked
WAITS_S = np.arange(STATES)[::-1] / RATE_HZ + 2 * KM * 1e3 / LIGHT_M_PER_S


def fidelity(t2_s: float) -> float:
    """Return that of the closed form: dephasing flips four of the six states."""
    return float(1 - (1 - np.exp(-WAITS_S / t2_s).mean()) / 3)


def measured(time: str, t2_s: float, load: int) -> float:
    """Return the fidelity of a run beside programs that compute."""
    with ExitStack() as stack:
        folder = stack.enter_context(TemporaryDirectory())
        for _ in range(load):
            program = subprocess.Popen([sys.executable, "-c", "while True: pass"])
            stack.callback(program.wait)
            stack.callback(program.kill)
        words = ["run", "teleport", "--count", str(STATES), "--rate-hz", str(RATE_HZ)]
        words += ["--length-km", str(KM), "--device", f"bob.memory.t2_s={t2_s}", "--time", time]
        words += ["--without", "report,record", "--captures", "none", "--runs", folder]
        subprocess.run([str(ROOT / "bin/qmn"), *words], check=True, stdout=subprocess.DEVNULL)
        result = json.loads(Path(folder, "latest/result.json").read_text())
        return float(result["job"]["asking"]["fidelity"])


def main() -> None:
    """Run, and draw."""
    figure, axes = plt.subplots(figsize=(6.4, 3.6), layout="constrained")
    fine = np.geomspace(T2_S[0], T2_S[-1], 100)
    axes.plot(1e3 * fine, [fidelity(each) for each in fine], color="0.6", label="closed form")
    for time, colour in (("stepped", "tab:blue"), ("paced", "tab:orange")):
        for load, marker in LOADS.items():
            found = [measured(time, each, load) for each in T2_S]
            label, t2_ms = f"{time}, {load} busy programs", 1e3 * np.array(T2_S)
            axes.plot(t2_ms, found, marker, color=colour, fillstyle="none", label=label)
    axes.set(xscale="log", xlabel="T2 of bob's memory (ms)", ylabel="fidelity")
    axes.set_xticks([1e3 * each for each in T2_S], [f"{1e3 * each:g}" for each in T2_S])
    axes.minorticks_off()
    axes.legend(fontsize="small")
    figure.savefig(ROOT / "docs/time.png", dpi=110)


if __name__ == "__main__":
    main()
