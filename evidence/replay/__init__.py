"""A run of the dispatcher done again from its record, and compared."""
