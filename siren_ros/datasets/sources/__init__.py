"""What exporters read: an episode's bag, frame by frame."""
