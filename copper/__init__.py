"""The copper of a network: packets take as long on it as its length needs."""
