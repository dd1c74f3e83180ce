"""The units of parameters, by the endings of their names."""

UNITS = (  # longer endings first
    ("_ps_per_sqrt_km", "ps/sqrt km"),
    ("_ps_per_nm_km", "ps/(nm km)"),
    ("_rad_per_sqrt_km", "rad/sqrt km"),
    ("_rad_per_s", "rad/s"),
    ("_k_per_sqrt_s", "K/sqrt s"),
    ("_k_per_s", "K/s"),
    ("_ppm_per_k", "ppm/K"),
    ("_per_km_nm", "1/(km nm)"),
    ("_mw", "mW"),
    ("_mbps", "Mbit/s"),
    ("_nm", "nm"),
    ("_db_per_km", "dB/km"),
    ("_km", "km"),
    ("_db", "dB"),
    ("_hz", "Hz"),
    ("_ps", "ps"),
    ("_rad", "rad"),
    ("_ms", "ms"),
    ("_us", "us"),
    ("_ns", "ns"),
    ("_s", "s"),
    ("_dbm", "dBm"),
    ("_mhz", "MHz"),
    ("_pm", "pm"),
    ("_c", "°C"),
    ("_gib", "GiB"),
    ("_bytes", "bytes"),
)


def unit_of(name: str) -> str:
    """Return the unit that a name ends in, "" for none."""
    return next((unit for ending, unit in UNITS if name.endswith(ending)), "")
