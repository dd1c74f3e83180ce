"""Applications over the network; VERBS has the verbs by heading, each with its module and help."""

VERBS = {
    "start a network": {
        "netqasm": ("applications.netqasm.verb", "run a NetQASM application on hosts"),
    },
    "use the simulator alone": {
        "sabot": ("applications.circuits.verb", "run quantum circuits on the simulator alone"),
    },
}
