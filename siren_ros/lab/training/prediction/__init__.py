"""Training of the trajectory predictor: the plan of episodes, samples out of bags, figures."""
