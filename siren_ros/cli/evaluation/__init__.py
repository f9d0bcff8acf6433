"""The tasks of `siren evaluate`, one file each."""
