"""What a host does to the light of others that goes by way of it."""
