"""What defines an episode: the request, templates, levels, presets of drivers, the recorded description."""
