"""The runs as tables: Parquet files of each run, a store of thousands of them, questions in SQL, comparisons.

Read in this order: `schema` (tables and columns), `run_tables` (from a run folder to its tables), `parquet` (the one
writer), `collection` (many runs as one store), `query` (SQL, read only), `examples`, `comparison` (two versions over
the same recordings).
"""
