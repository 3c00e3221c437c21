"""Writes the two trajectories beside this file and evo's figures for them. Needs `pip install evo numpy` (written with evo 1.38.1)."""
import copy
import json
import pathlib

import numpy as np
from evo.core import metrics, sync
from evo.tools import file_interface

here = pathlib.Path(__file__).parent
rng = np.random.default_rng(7)
t = 100.0 + 0.05 * np.arange(240)
s = t - t[0]
truth = np.stack([2.0 * np.sin(0.5 * s), 1.5 * np.cos(0.7 * s), 0.4 * np.sin(1.1 * s) + 0.05 * s], axis=1)
turn = np.stack([0.2 * np.sin(0.9 * s), 0.1 * np.cos(0.6 * s), 0.4 * s], axis=1)


def quaternion(v):
    angle = np.linalg.norm(v)
    return np.append(np.sinc(angle / 2 / np.pi) / 2 * v, np.cos(angle / 2))  # x y z w


def matrix(v):
    angle = np.linalg.norm(v)
    k = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]]) / angle
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def product(a, b):
    (ax, ay, az, aw), (bx, by, bz, bw) = a, b
    return np.array([aw * bx + ax * bw + ay * bz - az * by, aw * by - ax * bz + ay * bw + az * bx,
                     aw * bz + ax * by - ay * bx + az * bw, aw * bw - ax * bx - ay * by - az * bz])


world = np.array([0.1, -0.2, 1.3])
turns = np.array([quaternion(v) for v in turn])
drift = np.cumsum(rng.normal(0, 0.003, truth.shape), axis=0)
estimate = 0.98 * (truth + drift) @ matrix(world).T + np.array([4.0, -3.0, 1.0])
turned = np.array([product(quaternion(world), q) for q in turns])
for name, points, rotations in (("truth.tum", truth, turns), ("estimate.tum", estimate, turned)):
    rows = [f"{a:.9f} " + " ".join(f"{x:.9f}" for x in (*p, *q)) for a, p, q in zip(t, points, rotations)]
    (here / name).write_text("\n".join(rows) + "\n")
# The same truth in EuRoC's columns.
rows = [f"{round(a * 1e9)}," + ",".join(f"{x:.9f}" for x in (*p, q[3], *q[:3])) for a, p, q in zip(t, truth, turns)]
(here / "truth.csv").write_text("#timestamp,px,py,pz,qw,qx,qy,qz\n" + "\n".join(rows) + "\n")

reference = file_interface.read_tum_trajectory_file(here / "truth.tum")
estimated = file_interface.read_tum_trajectory_file(here / "estimate.tum")
reference, estimated = sync.associate_trajectories(reference, estimated)
_, _, scale = copy.deepcopy(estimated).align(reference, correct_scale=True)
estimated.align(reference)
ape = metrics.APE(metrics.PoseRelation.translation_part)
ape.process_data((reference, estimated))
figures = {**{k: float(v) for k, v in ape.get_all_statistics().items() if k in ("rmse", "mean", "median", "max")}, "scale": float(scale)}
(here / "evo.json").write_text(json.dumps(figures, indent=2) + "\n")
print(figures)
