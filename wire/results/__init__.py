"""The result of a network or a run: result.json, which programs and people read when it is over."""
