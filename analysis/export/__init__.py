"""Trials and fits for other programs: CSV, NWB, Parquet."""
