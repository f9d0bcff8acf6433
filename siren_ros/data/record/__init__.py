"""The record in use: bags opened and surveyed, steps sampled, vehicles located, the interaction region."""
