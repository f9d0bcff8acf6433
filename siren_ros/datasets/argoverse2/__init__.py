"""Argoverse 2 motion forecasting: scenarios and maps that av2 loads."""
