"""Topics, frames and messages of a sensor suite on its carrier."""
