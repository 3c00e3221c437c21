"""Losses. `u` is the scale of a Laplace distribution: |r| / u + log u is its negative log-likelihood up to log 2.

Supervised: r is the error of the log depth, so that u means the same at every distance.
Self-supervised: r is the photometric error as in the paper, L_self = sum r_pho / u + log u; u is then no depth error.
"""

import torch
from torch.nn import functional as F


def supervised(log_depth, u, depth, weights=(1.0, 0.5, 1.0, 0.0)) -> torch.Tensor:
    """Mean over known depths of `nll * (|r|/u + log u) + gradient * |grad r| + plain * |r|`, and over images of `scale` times
    their |mean r|: the factor that an image is off by. Depth 0 is unknown."""
    nll, gradient, plain, *scale = weights
    known = depth > 0
    r = torch.where(known, log_depth - torch.log(depth.clamp(min=1e-3)), torch.zeros_like(depth))
    count = known.sum().clamp(min=1)
    loss = nll * (torch.where(known, r.abs() / u + torch.log(u), torch.zeros_like(r))).sum() / count
    loss = loss + plain * r.abs().sum() / count
    if scale and scale[0] > 0:
        loss = loss + scale[0] * (r.sum((1, 2, 3)) / known.sum((1, 2, 3)).clamp(min=1)).abs().mean()
    if gradient > 0:
        for step in (1, 4):
            for axis in (2, 3):
                n = r.shape[axis] - step
                both = known.narrow(axis, step, n) & known.narrow(axis, 0, n)
                change = (r.narrow(axis, step, n) - r.narrow(axis, 0, n)).abs()
                loss = loss + gradient * 0.5 * (change * both).sum() / both.sum().clamp(min=1)
    return loss


def smoothness(log_depth, image) -> torch.Tensor:
    """Gradients of the inverse depth over its mean, less where the image has an edge."""
    inverse = torch.exp(-log_depth)
    inverse = inverse / inverse.mean((2, 3), keepdim=True)
    small = F.interpolate(image, inverse.shape[2:], mode="area")
    loss = 0.0
    for axis in (2, 3):
        d = inverse.diff(dim=axis).abs()
        e = small.diff(dim=axis).abs()
        loss = loss + (d * torch.exp(-10 * e)).mean()
    return loss


def photometric_error(a, b) -> torch.Tensor:
    """0.85 (1 - SSIM) / 2 + 0.15 |a - b|, per pixel."""
    pool = lambda x: F.avg_pool2d(F.pad(x, (1, 1, 1, 1), mode="reflect"), 3, 1)
    ma, mb = pool(a), pool(b)
    va, vb, vab = pool(a * a) - ma * ma, pool(b * b) - mb * mb, pool(a * b) - ma * mb
    c1, c2 = 0.01**2, 0.03**2
    ssim = ((2 * ma * mb + c1) * (2 * vab + c2)) / ((ma * ma + mb * mb + c1) * (va + vb + c2))
    return 0.85 * ((1 - ssim) / 2).clamp(0, 1) + 0.15 * (a - b).abs()


class Warp:
    """Samples source images where the depths of a target image say its pixels went; raw images on both sides."""

    def __init__(self, rays: torch.Tensor):
        self.rays = rays  # (h, w, 3) of the target's camera at the resolution of the comparison

    def __call__(self, log_depth, source, source_from_target, intrinsics, distortion):
        """`source` (B, 1, H, W), `source_from_target` (B, 4, 4), `intrinsics` (B, 4) normalised, `distortion` (B, 4).
        Returns the target as seen in the source, and where that is known."""
        height, width = self.rays.shape[:2]
        depth = torch.exp(F.interpolate(log_depth, (height, width), mode="bilinear", align_corners=False))
        points = depth[:, 0, :, :, None] * self.rays
        points = points @ source_from_target[:, None, :3, :3].transpose(-1, -2) + source_from_target[:, None, None, :3, 3]
        z = points[..., 2].clamp(min=0.05)
        x, y = points[..., 0] / z, points[..., 1] / z
        k1, k2, p1, p2 = (distortion[:, k, None, None] for k in range(4))
        r2 = (x * x + y * y).clamp(max=2.5)
        radial = 1 + k1 * r2 + k2 * r2 * r2
        xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        fx, fy, cx, cy = (intrinsics[:, k, None, None] for k in range(4))
        grid = torch.stack([2 * (fx * xd + cx) - 1, 2 * (fy * yd + cy) - 1], -1)
        known = (points[..., 2] > 0.05) & (grid.abs() < 1).all(-1)
        return F.grid_sample(source, grid, mode="bilinear", padding_mode="border", align_corners=False), known[:, None]


def self_supervised(u, target, warped: list, still: list) -> torch.Tensor:
    """`sum r_pho / u + log u` with the per-pixel minimum over sources. Pixels that no warp explains better than the source
    as it is (nothing moved, or it moved with the camera) do not count."""
    errors = [torch.where(known, photometric_error(target, image), torch.full_like(target, 1e3)) for image, known in warped]
    r = torch.stack(errors).amin(0)
    unmoved = torch.stack([photometric_error(target, image) for image in still]).amin(0)
    counts = (r < unmoved) & (r < 10)
    u = F.interpolate(u, target.shape[2:], mode="bilinear", align_corners=False)
    return (torch.where(counts, r / u + torch.log(u), torch.zeros_like(r))).sum() / counts.sum().clamp(min=1)
