"""Scores models on recorded episodes by the paper's protocols. Evaluators read a record and nothing else."""
