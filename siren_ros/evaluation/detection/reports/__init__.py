"""Tables, curves and pictures of the scores."""
