"""nuScenes export: tables and files that nuscenes-devkit loads."""
