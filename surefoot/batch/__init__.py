"""Many recordings: one verb over folders, lists or object stores, on this machine or on a cluster.

Read in this order: `job` (one verb on one recording), `places` (the jobs of some places), `work` (a job in a worker
process), `worker` (that process, and who starts it), `pool` and `dask_cluster` (where jobs run), `ledger` (what has
happened, in a plain file), `batch` (everything put together), `pages` (table and page of the whole).
"""
