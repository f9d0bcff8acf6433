"""What the tasks of the evaluation share: intervals, paired comparisons, rank correlation. Knows no episodes."""
