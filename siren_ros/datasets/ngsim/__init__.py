"""NGSIM: tracks that the loaders of NGSIM-trained predictors read."""
