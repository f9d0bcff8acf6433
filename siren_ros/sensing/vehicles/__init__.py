"""Shapes of vehicles: cars, large vehicles, emergency vehicles."""
