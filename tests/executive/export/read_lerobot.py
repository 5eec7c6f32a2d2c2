"""Reads a data set with LeRobot itself, in an environment that has it, and prints what it finds as JSON.

PYTHON read_lerobot.py FOLDER
"""

import json
import sys

from lerobot.datasets.lerobot_dataset import LeRobotDataset

folder = sys.argv[1]
data = LeRobotDataset("local/run", root=folder, video_backend="pyav")
camera = data.meta.camera_keys[0]
rows = [data[index] for index in range(len(data))]
ahead = LeRobotDataset(
    "local/run", root=folder, video_backend="pyav", delta_timestamps={"action": [0.0, 1 / data.fps], camera: [0.0]}
)
print(
    json.dumps(
        {
            "episodes": data.num_episodes,
            "frames": data.num_frames,
            "fps": data.fps,
            "cameras": list(data.meta.camera_keys),
            "tasks": [row["task"] for row in rows],
            "states": [row["observation.state"].tolist() for row in rows],
            "actions": [row["action"].tolist() for row in rows],
            "atoms": [row["loop.atoms"].tolist() for row in rows if "loop.atoms" in row],
            "steps": [row.get("loop.step", row.get("skill.action")) for row in rows],
            "success": [bool(row["next.success"]) for row in rows],
            "brightness": [float(row[camera].mean()) for row in rows],
            "next_action": ahead[0]["action"].tolist(),
            "picture": list(ahead[0][camera].shape),
            "mean": [float(value) for value in data.meta.stats["observation.state"]["mean"]],
            "runs": [data.meta.episodes[number]["executive/run"] for number in range(data.num_episodes)],
        }
    )
)
