"""Predictors of others, trained on NGSIM: CSP, STDAN and BAT, with the weights that their authors published."""
