"""The console command ``siren``: work on recorded episodes, without ROS."""
