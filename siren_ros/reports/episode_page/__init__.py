"""The page of an episode: one HTML file with the scene in 3-D, a timeline, and the actions of each vehicle."""
