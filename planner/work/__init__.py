"""Workers, which are threads or a Dask cluster, and reports of progress."""
