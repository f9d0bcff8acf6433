"""OpenSCENARIO: everybody follows the recorded trajectory on the exported OpenDRIVE map."""
