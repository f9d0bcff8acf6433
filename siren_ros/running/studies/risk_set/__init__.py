"""Makes a set of front-camera videos with risk labels by a search for a class balance; no scene is scripted."""
