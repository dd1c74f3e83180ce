"""The key manager of a host: fills its key stores, and delivers keys by ETSI GS QKD 014."""
