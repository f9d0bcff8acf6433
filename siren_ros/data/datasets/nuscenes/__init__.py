"""nuScenes: tables and files that nuscenes-devkit loads."""
