"""A course of six exercises; VERBS has the verb by heading, with its module and help."""

VERBS = {"make experiments": {"course": ("course.verb", "check an exercise of the course")}}
