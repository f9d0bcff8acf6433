"""Sites: the place of a map where a template can happen, found on any network."""
