"""Makes a set of front-camera videos with risk labels: searched for a balance of classes, never scripted."""
