"""A script as `qmn script` runs it, as a program: python -m qmn.scripting.script FILE …

It is what Python would run, but that being interrupted, also while a network starts, is one line.
"""

import runpy
import signal
import sys
from pathlib import Path
from types import TracebackType

from topologies.system.processes.outputs import with_outputs
from topologies.system.processes.signals import Interrupted, interrupted_words

INTERRUPTED = 128 + signal.SIGINT


def main() -> int:
    """Run the script that is named with its arguments; return its exit status."""
    return with_outputs(run_script)


def run_script() -> int:
    """Run it as the main program."""
    del sys.argv[0]
    file = sys.argv[0]
    sys.path.insert(0, str(Path(file).resolve().parent))
    sys.excepthook = _tell
    try:
        runpy.run_path(file, run_name="__main__")
    except Interrupted as error:
        print(f"qmn: {interrupted_words(error)}", file=sys.stderr)
        return error.status
    except KeyboardInterrupt as error:
        print(f"qmn: {interrupted_words(error)}", file=sys.stderr)
        return INTERRUPTED
    return 0


def _tell(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Print a traceback that begins in the script, as that of Python does."""
    while trace and trace.tb_frame.f_code.co_filename != sys.argv[0]:
        trace = trace.tb_next
    sys.__excepthook__(kind, error.with_traceback(trace), trace)


if __name__ == "__main__":
    sys.exit(main())
