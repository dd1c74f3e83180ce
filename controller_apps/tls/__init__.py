"""Where switches come in by TLS, before the framework that serves them."""
