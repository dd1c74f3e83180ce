"""The OpenFlow proxy: to controllers the bridge is an optical switch."""
