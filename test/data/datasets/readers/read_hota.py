"""HOTA of sequences by TrackEval: the first argument is a JSON file with numbers and similarities by frame."""

import json
import sys
from pathlib import Path

import numpy as np
import trackeval

sequences = {}
metric = trackeval.metrics.HOTA()
for name, frames in json.loads(Path(sys.argv[1]).read_text()).items():
    shapes = [(len(frame["labels"]), len(frame["tracks"])) for frame in frames]
    data = {
        "gt_ids": [np.array(frame["labels"], dtype=int) for frame in frames],
        "tracker_ids": [np.array(frame["tracks"], dtype=int) for frame in frames],
        "similarity_scores": [
            np.array(f["alike"], dtype=float).reshape(s) for f, s in zip(frames, shapes, strict=True)
        ],
    }
    data["num_gt_ids"] = 1 + max((number for frame in frames for number in frame["labels"]), default=-1)
    data["num_tracker_ids"] = 1 + max((number for frame in frames for number in frame["tracks"]), default=-1)
    data["num_gt_dets"], data["num_tracker_dets"] = (sum(column) for column in zip(*shapes, strict=True))
    sequences[name] = metric.eval_sequence(data)
combined = metric.combine_sequences(sequences)
print(json.dumps({name: float(np.mean(combined[name])) for name in ("HOTA", "DetA", "AssA")}))
