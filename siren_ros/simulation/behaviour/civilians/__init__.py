"""The civilians (paper, Algorithm 2): who yields, how, and how they return to traffic."""
