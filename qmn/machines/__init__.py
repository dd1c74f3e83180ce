"""Networks over several machines: their Dask workers, and which hosts are where."""
