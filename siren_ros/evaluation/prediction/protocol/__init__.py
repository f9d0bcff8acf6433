"""What a predictor gets and gives: windows, samples, hypotheses."""
