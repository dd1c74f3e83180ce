"""Networks as the user names and sets them, before anything starts."""
