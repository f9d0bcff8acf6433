"""`siren generate` of whole sets, and the options that sets share."""
