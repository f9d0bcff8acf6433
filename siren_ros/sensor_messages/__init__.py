"""A suite's measurements as topics, frames and messages of the vehicle that carries it."""
