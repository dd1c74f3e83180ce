"""Changes of a running network, one `qmn set WHAT` each."""
