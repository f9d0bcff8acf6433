"""Tables and pictures of the risk task."""
