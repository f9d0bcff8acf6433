"""Training of the pillar detector: frames out of bags, targets, augmentation, fitting, figures."""
