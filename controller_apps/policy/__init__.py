"""Who may open which session, how hosts are set, and in which order repeaters swap."""
