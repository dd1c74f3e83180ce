"""Views of runs: reports, live pages, dissectors; VERBS: verbs by heading, with module and help."""

VERBS = {
    "look at a network, or at a run": {
        "live": ("views.verbs.live", "see it in the browser"),
        "report": ("views.verbs.report", "rebuild the report of a run"),
    },
}
