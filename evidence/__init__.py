"""Experiments around the core; VERBS has the verb by heading, with its module and help."""

VERBS = {
    "use the simulator alone": {
        "replay": ("evidence.replay.verb", "repeat the work of a run's dispatcher, and compare"),
    },
    "make experiments": {
        "lab": ("evidence.verb", "demos, published results, curves, sweeps, attacks, benchmarks"),
    },
}
