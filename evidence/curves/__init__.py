"""Sweeps: grids, experiments, theory, tables and figures."""
