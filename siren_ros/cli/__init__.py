"""The console command ``siren``: everything that is done with recorded episodes, without ROS."""
