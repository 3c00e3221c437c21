"""Self-supervision on EuRoC folders: the other eye, and images shortly before and after where the truth knows their poses."""

from pathlib import Path

import numpy as np
import torch
from torch.nn import functional as F

import losses
from camera import CANONICAL, EUROC, WIDTH, HEIGHT
from data import poses, small, split
from stereo import grey, pairs

NEIGHBOURS_NS = (-200_000_000, 200_000_000)


class PhotometricSource:
    """Targets are left images of pairs; sources the right image and neighbours of the left one."""

    def __init__(self, folder: Path, kind: str):
        all_pairs = pairs(folder)
        indices = range(len(all_pairs)) if kind == "all" else split(len(all_pairs), kind)["train"]
        inner = folder / "mav0" if (folder / "mav0").is_dir() else folder
        left_files = {int(path.stem): path for path in (inner / "cam0/data").iterdir()}
        truth_file = inner / "state_groundtruth_estimate0/data.csv"
        truth = poses(truth_file) if truth_file.exists() else {}
        stamps = np.array(sorted(truth))
        used = {all_pairs[k][0] for k in range(len(all_pairs))} - {all_pairs[k][0] for k in indices}
        left_from_body = np.linalg.inv(EUROC[0].body_from_camera)
        right_from_left = np.linalg.inv(EUROC[1].body_from_camera) @ EUROC[0].body_from_camera
        self.items = []
        for k in indices:
            stamp, left, right = all_pairs[k]
            sources = [(small(grey(right)), right_from_left, 1)]
            here = self.pose(truth, stamps, stamp)
            for offset in NEIGHBOURS_NS:
                there_stamp = stamp + offset
                there = self.pose(truth, stamps, there_stamp)
                # No keyframe that is kept out may be seen as a neighbour either.
                if here is None or there is None or there_stamp not in left_files or there_stamp in used:
                    continue
                motion = left_from_body @ np.linalg.inv(there) @ here @ EUROC[0].body_from_camera
                sources.append((small(grey(left_files[there_stamp])), motion, 0))
            self.items.append((small(grey(left)), sources))
        # Compared at half of the input's resolution.
        self.size = (HEIGHT // 2, WIDTH // 2)
        self.warp = losses.Warp(torch.from_numpy(CANONICAL.resized(WIDTH // 2, HEIGHT // 2).rays()).float())
        self.intrinsics = torch.from_numpy(np.stack([camera.normalised for camera in EUROC])).float()
        self.distortion = torch.tensor([camera.distortion for camera in EUROC])

    @staticmethod
    def pose(truth, stamps, stamp):
        if not len(stamps):
            return None
        nearest = int(stamps[np.abs(stamps - stamp).argmin()])
        return truth[nearest] if abs(nearest - stamp) < 2_600_000 else None

    def loss(self, network, draw, batch: int, device) -> torch.Tensor:
        items = [self.items[k] for k in draw.integers(0, len(self.items), batch)]
        tensor = lambda arrays: torch.from_numpy(np.stack(arrays))[:, None].float().to(device) / 255
        target = tensor([item[0] for item in items])
        log_depth, u = network.log_depth_and_u(target)
        half = F.interpolate(target, self.size, mode="area")
        self.warp.rays = self.warp.rays.to(device)
        most = max(len(item[1]) for item in items)
        warped, still = [], []
        for k in range(most):
            # An image with fewer sources is compared with its first one again.
            chosen = [item[1][k] if k < len(item[1]) else item[1][0] for item in items]
            source = F.interpolate(tensor([c[0] for c in chosen]), self.size, mode="area")
            motion = torch.from_numpy(np.stack([c[1] for c in chosen])).float().to(device)
            camera = torch.tensor([c[2] for c in chosen])
            warped.append(self.warp(log_depth, source, motion, self.intrinsics[camera].to(device), self.distortion[camera].to(device)))
            still.append(source)
        return losses.self_supervised(u, half, warped, still) + 1e-3 * losses.smoothness(log_depth, target)
