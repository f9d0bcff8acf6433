"""Pictures and videos of recorded episodes."""
