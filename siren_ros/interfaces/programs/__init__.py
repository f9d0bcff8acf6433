"""Messages of programs that take part: the AV's controller, a predictor."""
