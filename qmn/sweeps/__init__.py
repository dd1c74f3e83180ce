"""What sweeps consist of: grids, experiments, theory, tables and figures."""
