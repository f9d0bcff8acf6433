"""What a record is worth: whether the interaction happened, and how well models did."""
