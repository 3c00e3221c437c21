"""Depth of real stereo pairs by semi-global matching, in the raw pixels of either camera.

The pair is rectified, matched in both directions, kept where both agree to a pixel, and every raw pixel looks up the disparity
of its rectified place. The baseline comes from the calibration, so the depth is metric.
"""

from pathlib import Path

import cv2
import numpy as np

from camera import EUROC, Camera

DISPARITIES = 160
# The rectified canvas: nearly all raw pixels find a place on it.
FOCAL, CANVAS = 430.0, (960, 640)


class Matcher:
    def __init__(self, left: Camera = EUROC[0], right: Camera = EUROC[1]):
        right_from_left = np.linalg.inv(right.body_from_camera) @ left.body_from_camera
        self.baseline_m = float(np.linalg.norm(right_from_left[:3, 3]))
        self.rotations = cv2.stereoRectify(
            left.matrix, np.array(left.distortion), right.matrix, np.array(right.distortion), left.size,
            right_from_left[:3, :3], right_from_left[:3, 3:],
        )[:2]
        self.projection = np.array([[FOCAL, 0, CANVAS[0] / 2], [0, FOCAL, CANVAS[1] / 2], [0, 0, 1]])
        cameras = (left, right)
        self.maps = [
            cv2.initUndistortRectifyMap(c.matrix, np.array(c.distortion), r, self.projection, CANVAS, cv2.CV_32FC1)
            for c, r in zip(cameras, self.rotations)
        ]
        self.rays = [camera.rays() for camera in cameras]
        window = 5
        self.matcher = cv2.StereoSGBM_create(
            0, DISPARITIES, window, 8 * window**2, 32 * window**2, 1, 31, 10, 100, 2, cv2.STEREO_SGBM_MODE_SGBM_3WAY
        )

    def match(self, one: np.ndarray, other: np.ndarray) -> np.ndarray:
        """The matcher gives nothing on a strip as wide as its range: a margin takes that."""
        one, other = (cv2.copyMakeBorder(image, 0, 0, DISPARITIES, 0, cv2.BORDER_CONSTANT) for image in (one, other))
        return self.matcher.compute(one, other)[:, DISPARITIES:].astype(np.float32) / 16

    def disparities(self, left: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rectified disparities of the left and of the right image, px; 0 where there is none."""
        l, r = (cv2.remap(image, *maps, cv2.INTER_LINEAR) for image, maps in zip((left, right), self.maps))
        seen = [cv2.remap(np.ones_like(left), *maps, cv2.INTER_NEAREST) > 0 for maps in self.maps]
        of_left = self.match(l, r)
        # Mirrored, the right image is a left one.
        of_right = self.match(np.ascontiguousarray(r[:, ::-1]), np.ascontiguousarray(l[:, ::-1]))[:, ::-1]
        columns = np.arange(l.shape[1], dtype=np.float32)[None].repeat(l.shape[0], 0)
        rows = np.arange(l.shape[0], dtype=np.float32)[:, None].repeat(l.shape[1], 1)
        there = cv2.remap(of_right, columns - of_left, rows, cv2.INTER_NEAREST, borderValue=-99)
        back = cv2.remap(of_left, columns + of_right, rows, cv2.INTER_NEAREST, borderValue=-99)
        good_left = (of_left > 1) & (abs(there - of_left) < 1) & seen[0]
        good_right = (of_right > 1) & (abs(back - of_right) < 1) & seen[1]
        return np.where(good_left, of_left, 0), np.where(good_right, of_right, 0)

    def raw_depths(self, left: np.ndarray, right: np.ndarray) -> list[np.ndarray]:
        """Depth along the optical axis for every raw pixel of both images, m; 0 where unknown."""
        depths = []
        for k, disparity in enumerate(self.disparities(left, right)):
            rotated = self.rays[k] @ self.rotations[k].T
            x = (FOCAL * rotated[..., 0] / rotated[..., 2] + CANVAS[0] / 2).astype(np.float32)
            y = (FOCAL * rotated[..., 1] / rotated[..., 2] + CANVAS[1] / 2).astype(np.float32)
            d = cv2.remap(disparity, x, y, cv2.INTER_NEAREST, borderValue=0)
            # A rectified point Z (ray / ray_z) has depth Z / ray_z on a raw ray whose third component is one.
            z = FOCAL * self.baseline_m / np.maximum(d, 1e-3) / rotated[..., 2]
            depths.append(np.where((d > 1) & (z < 25), z, 0).astype(np.float32))
        return depths


def grey(path: Path) -> np.ndarray:
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise SystemExit(f"{path}: no image that can be read")
    return image


def pairs(folder: Path) -> list[tuple[int, Path, Path]]:
    """Stamp, left and right file of a EuRoC folder (`mav0`, or one with `cam0` and `cam1` in it), in order of time."""
    inner = folder / "mav0"
    folder = inner if inner.is_dir() else folder
    right = {path.stem: path for path in (folder / "cam1/data").iterdir()}
    left = sorted((folder / "cam0/data").iterdir())
    return [(int(path.stem), path, right[path.stem]) for path in left if path.stem in right]


def block_depth(depth: np.ndarray, rows: int, columns: int, least: float = 0.4) -> np.ndarray:
    """Median of the known depths in every block of a raw map; 0 where fewer than a share of them are known."""
    height, width = depth.shape
    y, x = np.linspace(0, height, rows + 1).astype(int), np.linspace(0, width, columns + 1).astype(int)
    # Blocks differ by a pixel in size: those of the largest are looked up, and what lies outside a block is unknown.
    (i, inside_i), (j, inside_j) = (
        ((at := edge[:-1, None] + np.arange(np.diff(edge).max())).clip(max=edge[-1] - 1), at < edge[1:, None]) for edge in (y, x)
    )
    cells = depth[i[:, None, :, None], j[None, :, None, :]].reshape(rows, columns, -1)
    inside = (inside_i[:, None, :, None] & inside_j[None, :, None, :]).reshape(cells.shape)
    cells = np.sort(np.where(inside & (cells > 0), cells, np.inf), axis=-1)
    count = np.isfinite(cells).sum(-1)
    middle = [np.take_along_axis(cells, np.maximum(count - k, 0)[..., None] // 2, -1)[..., 0] for k in (0, 1)]
    enough = (count > 0) & (count >= least * inside.sum(-1))
    return np.where(enough, (middle[0] + middle[1]) / 2, 0).astype(np.float32)
