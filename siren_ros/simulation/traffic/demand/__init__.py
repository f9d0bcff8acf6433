"""Who drives where: the plan of an episode's vehicles, made before SUMO starts."""
