"""Words of the command line that 0.1 still takes, and what they are now."""

import shlex
import sys
from collections.abc import Mapping, Sequence
from difflib import get_close_matches

TOPOLOGIES = ("sdc", "chain", "ring", "leaf-spine", "repeaters", "tree", "tapped", "map")
USUAL = {"swap": "chain", "load": "ring"}  # topologies of jobs; of others sdc
CHANGES = ("link", "fault", "tap", "classical", "calibrate", "policy")
EXPERIMENTS = ("demo", "curves", "sweep", "attack", "bench")
# First words of a command line, and what they are now.
VERBS: Mapping[tuple[str, ...], tuple[str, ...]] = {
    **{("run", name): ("run", "sdc", "--topology", name) for name in TOPOLOGIES[1:]},
    **{(name,): ("set", name) for name in CHANGES},
    ("set",): ("set", "host"),
    **{(name,): ("lab", name) for name in EXPERIMENTS},
    ("lab",): ("lab", "published"),
    ("share",): ("runs", "export"),
}
# Words behind verbs that had no kinds before, by which today's are known.
OF_TODAY = {
    "set": {*CHANGES, "host", "-h", "--help"},
    "lab": {*EXPERIMENTS, "published", "-h", "--help"},
}
# Verbs that start networks, and options of theirs that are parameters of topologies now.
WITH_NETWORK = ("run", "cli", "netqasm")
WITH_VALUE = (
    *("--map", "--hosts-at", "--sources-at", "--repeaters-at", "--fibers", "--repeaters"),
    *("--hosts", "--switches", "--leaves", "--spines"),
)
# Experiments of the physical layer alone.
RENAMED = {"handed-over": "fidelity-age", "pairs-made": "overhead", "spied-pairs": "eavesdropping"}
WITHOUT_VALUE = ("--stations", "--both-ways")
# Other options of these verbs.
OPTIONS: Mapping[str, tuple[str, ...]] = {
    "--capture": ("--captures", "full"),
    "--no-capture": ("--captures", "none"),
    "--no-events": ("--without", "events"),
    "--no-record": ("--without", "record"),
    "--no-report": ("--without", "report"),
    "--no-looking": ("--no-state-inspection",),
}


def translated(words: Sequence[str]) -> list[str]:
    """Return a command line in today's words; say on stderr what it is if it had others."""
    today = list(words)
    for old, new in VERBS.items():
        if tuple(words[: len(old)]) == old and not _has_kind(words):
            today[: len(old)] = new
    if today[:2] == ["run", "switch_swap"]:
        today[1] = "swap"
    if today[:1] and today[0] in WITH_NETWORK:
        today = _with_pace([new for word in today for new in OPTIONS.get(word, (word,))])
        today = _with_parameters(today)
    if today[:2] == ["run", "swap"] or today[:3] == ["lab", "sweep", "swap"]:
        today = [_of_switches(word) for word in today]
    if today[:2] in (["lab", "curves"], ["lab", "sweep"]):
        parts = [word.rpartition("=") for word in today]
        today = [f"{flag}{equals}{RENAMED.get(name, name)}" for flag, equals, name in parts]
    if today[:2] == ["run", "distribute"]:
        today = _with_stations(today)
    if today != [*words]:
        print(
            f"note: these words are old; the new ones: {shlex.join(['qmn', *today])}",
            file=sys.stderr,
        )
    return today


def _with_stations(words: Sequence[str]) -> list[str]:
    """Have stations in all switches in place of a host that was one."""
    words_now: list[str] = []
    for word in words:
        stands = word.endswith("=station")
        if stands and words_now[-1] == "--node":
            words_now[-1:] = ["--switch", "parts=station"]
        elif stands and word.startswith("--node="):
            words_now.append("--switch=parts=station")
        else:
            words_now.append(word)
    return words_now


def _of_switches(word: str) -> str:
    """Return a chain of as many switches for the topology of hosts that were repeaters."""
    flag, equals, value = word.partition("=") if word.startswith("--") else ("", "", word)
    if flag == "--repeaters":  # of a sweep, which varies it
        return f"--switches{equals}{value}"
    name, *parameters = value.split(",")
    if name != "repeaters" and not any(each.startswith("repeaters=") for each in parameters):
        return word
    others = [each for each in parameters if each.partition("=")[0] != "stations"]
    stations = len(others) < len(parameters)
    return f"{flag}{equals}{','.join(['chain', *(_switches(each, stations) for each in others)])}"


def _switches(parameter: str, stations: bool) -> str:
    """Return as many switches for a number of repeaters, and those between if stations were."""
    name, equals, value = parameter.rpartition("=")
    if name not in ("", "repeaters"):
        return parameter
    if stations and value.isdecimal():
        value = str(2 * int(value) + 1)
    return f"switches={value}" if equals else value


def _has_kind(words: Sequence[str]) -> bool:
    """Return whether a verb with kinds is followed by one, perhaps misspelt, or by nothing."""
    if words[0] not in OF_TODAY:
        return False
    kinds = OF_TODAY[words[0]]
    if not words[1:] or words[1] in kinds:
        return True
    # No lab of ours is as much like a kind; a host may be called host1.
    return bool(get_close_matches(words[1], kinds - {"host"}, 1, 0.75))


def _with_pace(words: Sequence[str]) -> list[str]:
    """Name the pace of time by --time; it is stepped where a scale was chosen automatically."""
    rest = iter(words)
    replaced: list[str] = []
    for word in rest:
        flag, equals, value = word.partition("=")
        if flag != "--time-scale":
            replaced.append(word)
        elif (scale := value if equals else next(rest, "")) != "auto":
            replaced += ["--time", f"paced={scale}"]
    return replaced


def _with_parameters(words: Sequence[str]) -> list[str]:
    """Put the parameters of a topology behind its name, which is the usual one if it has none."""
    rest = iter(words)
    replaced: list[str] = []
    parameters: dict[str, str] = {}
    for word in rest:
        flag, equals, value = word.partition("=")
        if flag in WITHOUT_VALUE:
            parameters[flag] = ""
        elif flag in WITH_VALUE:
            parameters[flag] = f"={value if equals else next(rest, '')}"
        else:
            replaced.append(word)
    if not parameters:
        return replaced
    place = _place_of_topology(replaced, "map" if "--map" in parameters else "")
    named = [f"{flag[2:].replace('-', '_')}{value}" for flag, value in parameters.items()]
    replaced[place] = ",".join([replaced[place], *named])
    return replaced


def _place_of_topology(words: list[str], usual: str) -> int:
    """Return where the name of the topology is, and have one there."""
    if words[0] == "cli":
        names = [place for place, word in enumerate(words) if _is_topology(word)]
        return names[0] if names else _put(words, 1, usual or "sdc")
    for place, word in enumerate(words):
        if word.startswith("--topology="):
            words[place : place + 1] = word.split("=", 1)
    if "--topology" in words[:-1]:
        return words.index("--topology") + 1
    job = words[1] if words[0] == "run" and words[1:] else ""
    words += ["--topology"]
    return _put(words, len(words), usual or USUAL.get(job, "sdc"))


def _is_topology(word: str) -> bool:
    name = word.split(",", 1)[0]
    return name in TOPOLOGIES or ".py:" in name


def _put(words: list[str], place: int, name: str) -> int:
    words.insert(place, name)
    return place
