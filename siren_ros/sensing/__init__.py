"""What sensors measure in a 3-D scene. Knows neither topics nor messages."""
