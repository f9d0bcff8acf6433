"""Data of an episode: messages, rules of the lockstep, bags, records read from them, and datasets."""
