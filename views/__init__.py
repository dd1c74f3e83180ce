"""Views of runs: reports, live pages, dissectors; VERBS: verbs by heading, with module and help."""

VERBS = {
    "look at a network, or at a run": {
        "devices": ("views.verbs.devices", "show the state of all devices"),
        "paths": ("views.verbs.paths", "show light paths and fibres"),
        "keys": ("views.verbs.keys", "show key links and relays"),
        "spy": ("views.verbs.spy", "show what happens to the qubits"),
        "wireshark": ("views.verbs.wireshark", "open a run in Wireshark"),
        "runs": ("views.verbs.runs", "list, compare, prune and share runs"),
        "live": ("views.verbs.live", "show it in the browser"),
        "report": ("views.verbs.report", "rebuild the report of a run"),
    },
}
