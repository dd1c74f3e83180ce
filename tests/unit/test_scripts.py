"""Scripts that a user of macOS runs, where bash is 3.2 and tools are BSD's."""

import os
import re
import subprocess
import tarfile
from io import BytesIO
from pathlib import Path

import pytest
from limits import SOON_S

ROOT = Path(__file__).resolve().parents[2]
# Of docker/, `entry` runs in the container. Others of setup/ are for Debian alone.
SCRIPTS = ["docker/base", "docker/build", "docker/context", "docker/engine", "docker/run"]
SCRIPTS += ["docker/within", "setup/run-sdc"]
# Behind this line they are on a Debian.
DEBIAN_ALONE = {"docker/base": "command -v apt-get"}

# Features of bash since 4.0 (`CHANGES` in its sources), and of GNU's tools alone: name, how it is
# recognised, a line that must be.
NEWER = {
    "arrays read from lines": (r"\b(mapfile|readarray)\b", "mapfile -t lines < <(ls)"),
    "associative arrays": (r"\b(declare|local|typeset)\s+-\w*A", "declare -A names=([a]=1)"),
    "references to names": (r"\b(declare|local|typeset)\s+-\w*n", "local -n array=$1"),
    "global declarations": (r"\b(declare|typeset)\s+-\w*g", "declare -g name=1"),
    "letters of another case": (r"\$\{\w+(\[[^]]*\])?[,^]", 'echo "${mode,,}"'),
    "transformed values": (r"\$\{[^}]*@[A-Za-z]\}", 'echo "${words[@]@Q}"'),
    "whether a variable is set": (r"\[\[.*\s-v\s|\btest -v\b", "[[ ! -v $name ]] || exit"),
    "places from the end": (r"\$\{\w+\[-\d+\]\}|\$\{[\w@*]+: ?-\d+: ?-", 'echo "${words[-1]}"'),
    "negative lengths": (r"\$\{\w+:\s*\d+:\s*-\d+\}", 'echo "${word:0:-1}"'),
    "output and errors appended": (r"&>>", "make &>>log"),
    "errors into the pipe": (r"\|&", "make |& tee log"),
    "going on in case": (r";;?&", "a) echo ;;& b) echo ;;"),
    "coprocesses": (r"\bcoproc\b", "coproc cat"),
    "waiting for any": (r"\bwait\s+-\w*[nfp]", "wait -n"),
    "files at any depth": (r"\b(globstar|lastpipe|inherit_errexit)\b", "shopt -s globstar"),
    "time by printf": (r"%\([^)]*\)T", "printf '%(%F)T'"),
    "steps of a range": (r"\{\w+\.\.\w+\.\.\w+\}", "echo {0..10..2}"),
    "padded ranges": (r"\{0\d+\.\.\d+\}", "echo {01..10}"),
    "files by number": (r"\{\w+\}[<>]", "exec {log}>file"),
    "part of a second to read": (r"\bread\b.*\s-t\s*\d*\.\d", "read -t 0.1 line"),
    "read by count": (r"\bread\s+-\w*[Ni]", "read -N 4 word"),
    "names of characters": (r"\$'[^']*\\[uU]", r"echo $'\u00e4'"),
    "newer variables": (r"\$\{?(BASHPID|EPOCH\w+|SRANDOM)\b", "echo $BASHPID"),
    "empty arrays under set -u": (r'(?<!\+)"\$\{(?!options|command)\w+\[@\]\}"', 'ls "${rest[@]}"'),
    "timeout(1)": (r"(?<![-_./\w])timeout\s", "timeout 10 docker version"),
    "nproc(1)": (r"\bnproc\b", "make -j$(nproc)"),
    "GNU's realpath, readlink": (r"\brealpath\b|\breadlink -[fem]", 'realpath "$1"'),
    "GNU's sed": (r"\bsed\s+(-[nE]*[uirsz]|--\w)", "sed -un 's/a/b/p'"),
    "GNU's tar": (r"\btar\b.*\s--(mtime|owner|group|mode|append|null)\b", "tar --mtime=@0 -c ."),
    "GNU's find": (r"\bfind\b.*\s-(quit|printf|regextype)\b", "find . -print -quit"),
    "GNU's date, stat, grep": (r"\bdate -d|\bstat -c|\bgrep -\w*P", "stat -c %s file"),
    "GNU's xargs, cp, sort": (r"\bxargs -\w*r|\bcp -\w*[tT]\b|\bsort -V", "xargs -r ls"),
}


def code(script: str) -> list[str]:
    """Return the lines of a script that macOS runs."""
    lines = [line for line in (ROOT / script).read_text().splitlines() if line[:1] != "#"]
    end = DEBIAN_ALONE.get(script)
    return lines if end is None else lines[: next(n for n, line in enumerate(lines) if end in line)]


def test_what_is_newer_is_recognised() -> None:
    for what in NEWER:
        pattern, line = NEWER[what]
        assert re.search(pattern, line)


@pytest.mark.parametrize("script", SCRIPTS)
def test_scripts_that_macos_runs_have_nothing_newer_than_its_bash_and_tools(script: str) -> None:
    assert len(code(script)) > 5
    found = [
        f"{what}: {line.strip()}"
        for line in code(script)
        for what, (pattern, _line) in NEWER.items()
        if re.search(pattern, line)
    ]
    assert found == []


def test_every_script_of_docker_is_looked_at() -> None:
    ours = {
        f"docker/{path.name}" for path in (ROOT / "docker").iterdir() if os.access(path, os.X_OK)
    }
    assert ours - {"docker/entry"} <= set(SCRIPTS)


def git(folder: Path, *words: str) -> None:
    who = ["-c", "user.name=qmn", "-c", "user.email=qmn"]
    subprocess.run(["git", *who, *words], cwd=folder, check=True, capture_output=True)


def context(folder: Path) -> bytes:
    environment = {**os.environ, "PIP_CERT": str(folder.parent / "bundle")}
    command = [folder / "docker/context"]
    return subprocess.run(command, env=environment, check=True, capture_output=True).stdout


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """Return a small checkout with changes that are not committed."""
    (tmp_path / "bundle").write_text("a certificate")
    folder = tmp_path / "checkout"
    for name in ("docker", "product", "gone"):
        (folder / name).mkdir(parents=True)
    for name in ("product/old", "product/changed", "gone/file", "Makefile"):
        (folder / name).write_text(name)
    (folder / ".gitignore").write_text("*.pyc\n")
    (folder / "docker/context").write_bytes((ROOT / "docker/context").read_bytes())
    (folder / "docker/context").chmod(0o775)
    git(folder, "init", "--quiet")
    git(folder, "add", ".")
    git(folder, "commit", "--quiet", "--message", "all")
    (folder / "product/changed").write_text("changed")
    (folder / "product/new").write_text("new")
    (folder / "product/code.pyc").write_text("ignored")
    (folder / "gone/file").unlink()
    (folder / "notes").mkdir()
    (folder / "notes/mine").write_text("in no folder that is tracked")
    return folder


def test_the_image_is_made_of_what_is_tracked_or_new_in_a_tracked_folder(checkout: Path) -> None:
    with tarfile.open(fileobj=BytesIO(context(checkout))) as tar:
        found = {each.name: each for each in tar if each.isfile()}
        assert found.keys() == {
            ".gitignore",
            "Makefile",
            "certificates/bundle.crt",
            "docker/context",
            "product/changed",
            "product/new",
            "product/old",
        }
        file = tar.extractfile("product/changed")
        assert file is not None
        assert file.read() == b"changed"
        assert found["docker/context"].mode == 0o755
        assert found["product/old"].mode == 0o644
    status = subprocess.run(
        ["git", "status", "--short"], cwd=checkout, capture_output=True, text=True, check=True
    )
    assert "A " not in status.stdout  # the checkout's own index is as it was


def test_equal_files_make_an_equal_context_whenever_they_were_written(checkout: Path) -> None:
    before = context(checkout)
    for path in checkout.rglob("*"):
        if ".git" not in path.parts:
            os.utime(path, (1, 1))
    (checkout / "product/old").chmod(0o664)
    assert context(checkout) == before
    (checkout / "product/old").write_text("other")
    assert context(checkout) != before


def test_a_command_that_takes_too_long_is_ended() -> None:
    within = ROOT / "docker/within"
    done = subprocess.run([within, "9", "sh", "-c", "echo there; exit 3"], capture_output=True)
    assert (done.returncode, done.stdout) == (3, b"there\n")
    done = subprocess.run([within, "0", "sleep", "60"], capture_output=True, timeout=SOON_S)
    assert done.returncode == 128 + 9
