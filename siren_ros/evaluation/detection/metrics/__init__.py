"""Scores: nuScenes' own code for the tables; the same matching, compiled, for subsets and intervals."""
