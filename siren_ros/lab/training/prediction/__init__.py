"""Trains the trajectory predictor: plan of episodes, samples from bags, evaluation."""
