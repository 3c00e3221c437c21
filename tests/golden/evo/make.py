"""Writes the trajectories beside this file and evo's figures for them. Needs `pip install evo numpy` (written with evo 1.38.1).

The figures are those that evo prints with fewer digits:

    evo_ape tum truth.tum estimate.tum -a
    evo_rpe tum truth.tum estimate.tum --all_pairs -u m -d 1
    evo_rpe tum truth.tum estimate.tum --all_pairs -u m -d 1 -r angle_deg
"""
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
wander = np.cumsum(rng.normal(0, 0.001, truth.shape), axis=0)
turned = np.array([product(product(quaternion(world), q), quaternion(w)) for q, w in zip(turns, wander)])


def write(name, stamps, points, rotations):
    rows = [f"{a:.9f} " + " ".join(f"{x:.9f}" for x in (*p, *q)) for a, p, q in zip(stamps, points, rotations)]
    (here / name).write_text("\n".join(rows) + "\n")


write("truth.tum", t, truth, turns)
write("estimate.tum", t, estimate, turned)
# Steps of an eighth of a metre and pauses: two poses are often equally near to a distance, and many stand at the same place.
steps = rng.choice([0.0, 0.125, 0.25, 0.5, 0.75], size=60, p=[0.4, 0.15, 0.15, 0.15, 0.15])
line = np.stack([np.cumsum(steps), np.zeros(60), np.zeros(60)], axis=1)
bent = np.stack([0.96 * line[:, 0], 0.05 * np.sin(line[:, 0]), np.zeros(60)], axis=1)
level = np.array([quaternion(np.array([0.0, 0.0, 0.01 * i])) for i in range(60)])
write("pauses_truth.tum", t[:60], bent, np.tile(quaternion(np.zeros(3)), (60, 1)))
write("pauses_estimate.tum", t[:60], line, level)
# The same truth in EuRoC's columns.
rows = [f"{round(a * 1e9)}," + ",".join(f"{x:.9f}" for x in (*p, q[3], *q[:3])) for a, p, q in zip(t, truth, turns)]
(here / "truth.csv").write_text("#timestamp,px,py,pz,qw,qx,qy,qz\n" + "\n".join(rows) + "\n")



def relative(reference, estimated, distance):
    found = {"distance": distance}
    for name, relation in (("translation", metrics.PoseRelation.translation_part), ("rotation_deg", metrics.PoseRelation.rotation_angle_deg)):
        rpe = metrics.RPE(relation, delta=distance, delta_unit=metrics.Unit.meters, all_pairs=True)
        rpe.process_data((reference, estimated))
        found |= {"pairs": len(rpe.error), name: {k: float(v) for k, v in rpe.get_all_statistics().items() if k in ("rmse", "median")}}
    return found


def read(truth, estimate):
    pair = (file_interface.read_tum_trajectory_file(here / name) for name in (truth, estimate))
    return sync.associate_trajectories(*pair)


reference, estimated = read("truth.tum", "estimate.tum")
relatives = [relative(reference, estimated, distance) for distance in (0.5, 1.0, 2.0, 5.0, 10.0)]
pauses = [relative(*read("pauses_truth.tum", "pauses_estimate.tum"), distance) for distance in (0.9375, 2.0625, 3.0)]
_, _, scale = copy.deepcopy(estimated).align(reference, correct_scale=True)
estimated.align(reference)
ape = metrics.APE(metrics.PoseRelation.translation_part)
ape.process_data((reference, estimated))
figures = {k: float(v) for k, v in ape.get_all_statistics().items() if k in ("rmse", "mean", "median", "max")}
figures |= {"scale": float(scale), "rpe": relatives, "pauses": pauses}
(here / "evo.json").write_text(json.dumps(figures, indent=2) + "\n")
print(figures)
