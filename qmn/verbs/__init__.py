"""The verbs of qmn, one module each."""
