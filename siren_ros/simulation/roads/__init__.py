"""The road network: lanes, movements, signals, routes."""
