"""ScenarioNet: scenario descriptions that MetaDrive replays."""
