"""Experiments around the core; VERBS has the verb by heading, with its module and help."""

VERBS = {
    "make experiments": {
        "lab": ("evidence.verb", "demos, published results, curves, sweeps, attacks, benchmarks"),
    },
}
