"""Plans an episode's vehicles, their drivers and their routes before SUMO starts."""
