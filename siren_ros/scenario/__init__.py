"""What an episode is asked to be: templates, levels, presets of drivers, the description that is recorded."""
