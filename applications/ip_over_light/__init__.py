"""IP over light: an interface whose packets travel by superdense coding."""
