"""Reads records: opens and surveys bags, samples steps, locates vehicles, finds the interaction region."""
