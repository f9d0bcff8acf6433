"""Samples for users' own networks: arrays from bags and risk sets, packed into one Parquet file."""
