"""Scores models on recorded episodes by the paper's protocols. Evaluators need only the record."""
