"""Samples for people who train their own networks: arrays out of bags and risk sets, packed into one Parquet file."""
