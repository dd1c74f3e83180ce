"""Limits of a machine that a command has met, and what to do about each."""

import errno
import resource
import shutil
import tempfile
from pathlib import Path

REMEDIES = {
    errno.ENOSPC: "make room there, for bytes (`df`) or for files (`df -i`)",
    errno.EDQUOT: "make room there, or raise the quota",
    errno.EROFS: "mount it to be written to, or name another folder",
    errno.EMFILE: "raise the limit of open files, now {files} (`ulimit -n`)",
    errno.ENFILE: "raise the machine's limit of open files (`sysctl fs.file-max`)",
    errno.ENOMEM: "free memory",
    errno.ENODEV: "an interface was deleted; leave to a run what it has made",
    errno.EAGAIN: "allow more processes (`ulimit -u`, or pids.max of the control group)",
}


BLOCK_BYTES = 4_096  # of usual disks: with less free, nothing can be added


def limit_met(error: OSError) -> str:
    """Return the limit that an error tells of, and the remedy, "" if it tells of none."""
    if error.errno not in REMEDIES:
        return ""
    files, _hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    remedy = REMEDIES[error.errno].format(files=files)
    where = [str(error.filename)] if error.filename else []
    if error.errno == errno.ENOSPC and not where:
        where = full_disks()
    return ": ".join([*where, str(error.strerror), remedy])


def full_disks() -> list[str]:
    folders = Path("/run"), Path(tempfile.gettempdir()), Path.cwd()
    return [str(folder) for folder in folders if shutil.disk_usage(folder).free < BLOCK_BYTES]
