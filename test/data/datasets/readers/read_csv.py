"""Reads a trajectory.csv with pandas; prints its columns, the types they got, and each vehicle's track."""

import json
import sys

import pandas as pd

table = pd.read_csv(sys.argv[1])
tracks = {
    str(actor_id): {
        "steps": rows["step"].tolist(),
        "x": rows["x"].tolist(),
        "y": rows["y"].tolist(),
        "is_emv": bool(rows["is_emv"].astype(bool).all()),
        "period_s": sorted(rows["timestamp"].diff().dropna().round(6).unique().tolist()),
    }
    for actor_id, rows in table.groupby("actor_id")
}
answer = {
    "types": {name: kind.kind for name, kind in table.dtypes.items()},
    "missing": int(table.isna().sum().sum()),
    "speed_error_mps": float(((table.vx**2 + table.vy**2) ** 0.5 - table.speed_mps).abs().max()),
    "tracks": tracks,
}
print(json.dumps(answer))
