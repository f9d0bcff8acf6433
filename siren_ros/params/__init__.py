"""Files of parameters: where they are found, and YAML that is checked with line numbers."""
