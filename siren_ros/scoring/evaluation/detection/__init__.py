"""3-D object detection, scored by nuScenes' rules on recorded episodes."""
