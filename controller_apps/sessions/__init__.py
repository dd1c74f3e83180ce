"""Sessions and the set-up messages that ask for them: who gets light, and when."""
