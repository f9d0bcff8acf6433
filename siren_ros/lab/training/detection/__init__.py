"""Trains the pillar detector: frames from bags, targets, augmentation, fitting, evaluation."""
