"""Parameter files: how they are found, and YAML that is checked with line numbers."""
