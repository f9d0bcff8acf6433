"""Reports for people: an episode's page, a study's report, an exam's certificate."""
