"""Training of the models that ship with the project; the only folder with torch but the published predictors'."""
