"""The canonical camera, EuRoC's rig, and ways between raw pixels and rays.

The network's depths hold for an image with the normalised intrinsics of EuRoC's left camera (pixel edges at 0 and 1):
    fx / width = 0.60991   fy / height = 0.95270   (cx + 1/2) / width = 0.48898   (cy + 1/2) / height = 0.51849
and its radial-tangential distortion. An image whose focal length is z times as long shows the same thing at depth d as the
canonical camera would at d / z: targets are divided, and results multiplied, by z.
"""

from dataclasses import dataclass

import numpy as np

WIDTH, HEIGHT, STRIDE = 320, 192, 4


@dataclass(frozen=True, eq=False)
class Camera:
    size: tuple[int, int]
    focal: tuple[float, float]
    center: tuple[float, float]
    distortion: tuple[float, float, float, float]
    body_from_camera: np.ndarray | None = None

    @property
    def matrix(self) -> np.ndarray:
        return np.array([[self.focal[0], 0, self.center[0]], [0, self.focal[1], self.center[1]], [0, 0, 1]])

    @property
    def normalised(self) -> np.ndarray:
        (w, h), (fx, fy), (cx, cy) = self.size, self.focal, self.center
        return np.array([fx / w, fy / h, (cx + 0.5) / w, (cy + 0.5) / h])

    def resized(self, width: int, height: int) -> "Camera":
        sx, sy = width / self.size[0], height / self.size[1]
        return Camera(
            (width, height),
            (self.focal[0] * sx, self.focal[1] * sy),
            ((self.center[0] + 0.5) * sx - 0.5, (self.center[1] + 0.5) * sy - 0.5),
            self.distortion,
            self.body_from_camera,
        )

    def rays(self) -> np.ndarray:
        """(height, width, 3): the ray (x, y, 1) of every pixel centre."""
        x, y = np.meshgrid(np.arange(self.size[0], dtype=np.float64), np.arange(self.size[1], dtype=np.float64))
        xd, yd = (x.ravel() - self.center[0]) / self.focal[0], (y.ravel() - self.center[1]) / self.focal[1]
        k1, k2, p1, p2 = self.distortion
        x, y = xd.copy(), yd.copy()
        for _ in range(200):  # the fixed point halves its error at the corners and does far better inside
            r2 = x * x + y * y
            radial = 1 + k1 * r2 + k2 * r2 * r2
            x = 0.5 * x + 0.5 * (xd - 2 * p1 * x * y - p2 * (r2 + 2 * x * x)) / radial
            y = 0.5 * y + 0.5 * (yd - p1 * (r2 + 2 * y * y) - 2 * p2 * x * y) / radial
        xy = np.stack([x, y], -1)
        return np.concatenate([xy, np.ones((len(xy), 1))], 1).reshape(self.size[1], self.size[0], 3)

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Raw pixels of points (..., 3) in camera coordinates, and whether they lie in front within the lens' reach."""
        z = np.maximum(points[..., 2], 1e-6)
        x, y = points[..., 0] / z, points[..., 1] / z
        k1, k2, p1, p2 = self.distortion
        r2 = x * x + y * y
        radial = 1 + k1 * r2 + k2 * r2 * r2
        xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        pixels = np.stack([xd * self.focal[0] + self.center[0], yd * self.focal[1] + self.center[1]], -1)
        return pixels, (points[..., 2] > 1e-3) & (r2 < 2.5)


# Calibration of the EuRoC MAV dataset (Burri et al., IJRR 2016), the same on all its sequences.
EUROC = (
    Camera(
        (752, 480), (458.654, 457.296), (367.215, 248.375), (-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05),
        np.array([[0.0148655429818, -0.999880929698, 0.00414029679422, -0.0216401454975],
                  [0.999557249008, 0.0149672133247, 0.025715529948, -0.064676986768],
                  [-0.0257744366974, 0.00375618835797, 0.999660727178, 0.00981073058949], [0, 0, 0, 1]]),
    ),
    Camera(
        (752, 480), (457.587, 456.134), (379.999, 255.238), (-0.28368365, 0.07451284, -0.00010473, -3.55590700e-05),
        np.array([[0.0125552670891, -0.999755099723, 0.0182237714554, -0.0198435579556],
                  [0.999598781151, 0.0130119051815, 0.0251588363115, 0.0453689425024],
                  [-0.0253898008918, 0.0179005838253, 0.999517347078, 0.00786212447038], [0, 0, 0, 1]]),
    ),
)
CANONICAL = EUROC[0].resized(WIDTH, HEIGHT)
