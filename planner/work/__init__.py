"""Who does the work: threads of this machine or a Dask cluster, and how progress is told."""
