"""The requests of jobs: of each a frozen dataclass of all that it can be asked, for qmn/jobs.

The command line and keywords of scripts and sweeps fill it (qmn.options), result.json keeps it.
"""
