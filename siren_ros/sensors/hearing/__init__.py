"""The microphone and the sound of a siren."""
