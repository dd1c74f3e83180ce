"""Reports and live pages of runs; VERBS has the verbs by heading, each with its module and help."""

VERBS = {
    "look at a network, or at a run": {
        "live": ("views.verbs.live", "see it in the browser"),
        "report": ("views.verbs.report", "rebuild the report of a run"),
    },
}
