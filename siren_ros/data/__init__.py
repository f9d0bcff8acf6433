"""How an episode is told: messages, the lockstep's rules, bags, records read from them, and datasets."""
