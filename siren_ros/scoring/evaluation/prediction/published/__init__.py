"""Published predictors trained on NGSIM: CSP, STDAN and BAT, with their authors' weights."""
