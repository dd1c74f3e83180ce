"""Experiments around the core; VERBS has the verbs by heading, each with its module and help."""

VERBS = {
    "make experiments": {
        "sweep": ("evidence.verbs.sweep", "measure a grid of parameters"),
        "curves": ("evidence.verbs.curves", "check the physics against theory"),
        "lab": ("evidence.verbs.lab", "published results as runs of the network"),
        "demo": ("evidence.verbs.demo", "show effects of a whole network"),
        "attack": ("evidence.verbs.attack", "try an attack on an emulated network"),
        "bench": ("evidence.verbs.bench", "measure this machine"),
    },
}
