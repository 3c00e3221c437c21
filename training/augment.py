"""What a real lens and sensor do to an image, drawn at random for a batch; depths are only mirrored.

Rendered rooms lack blown-out windows, motion blur, gamma and dirt. All draws come from the generator that is handed in.
"""

import math

import torch
from torch.nn import functional as F


def between(generator, low: float, high: float, *shape: int) -> torch.Tensor:
    return low + (high - low) * torch.rand(*shape, generator=generator)


def mirrored(image: torch.Tensor, depth: torch.Tensor, generator) -> tuple[torch.Tensor, torch.Tensor]:
    """Half of the batch left to right; the principal point is within 2 % of the middle."""
    flip = torch.rand(len(image), generator=generator) < 0.5
    image, depth = image.clone(), depth.clone()
    image[flip], depth[flip] = image[flip].flip(-1), depth[flip].flip(-1)
    return image, depth


def photometric(image: torch.Tensor, generator, strength: float = 1.0) -> torch.Tensor:
    batch, _, height, width = image.shape
    one = (batch, 1, 1, 1)
    # Uneven light: a smooth field.
    field = torch.randn(batch, 1, 3, 5, generator=generator) * between(generator, 0.0, 0.35 * strength, *one)
    x = image * torch.exp(F.interpolate(field, (height, width), mode="bicubic", align_corners=True))
    # Exposure with saturation, contrast about the mean, response curve.
    x = (x * torch.exp(between(generator, -0.5, 0.7, *one) * strength)).clamp(0, 1)
    mean = x.mean((2, 3), keepdim=True)
    x = mean + (x - mean) * torch.exp(between(generator, -0.5, 0.35, *one) * strength)
    x = (x + between(generator, -0.1, 0.1, *one) * strength).clamp(1e-3, 1)
    x = x ** torch.exp(between(generator, -0.5, 0.5, *one) * strength)
    # Negative pictures: brightness says nothing about depth.
    negative = (torch.rand(one, generator=generator) < 0.05 * strength).float()
    x = negative * (1 - x) + (1 - negative) * x
    x = blurred(x, generator, strength)
    noise = between(generator, 0.0, 0.03 * strength, *one)
    x = x + noise * torch.randn(x.shape, generator=generator)
    return erased(x.clamp(0, 1), generator, strength)


def blurred(x: torch.Tensor, generator, strength: float) -> torch.Tensor:
    """A third out of focus, a third moved, a third sharp; each image with its own 7 x 7 kernel."""
    batch = len(x)
    grid = torch.arange(-3.0, 4.0)
    v, u = torch.meshgrid(grid, grid, indexing="ij")
    kind = torch.rand(batch, generator=generator)
    sigma = between(generator, 0.3, 0.3 + 1.0 * strength, batch, 1, 1)
    round_ = torch.exp(-(u * u + v * v) / (2 * sigma**2))
    angle = between(generator, 0, math.pi, batch, 1, 1)
    length = between(generator, 0.5, 0.5 + 2.5 * strength, batch, 1, 1)
    along, across = u * angle.cos() + v * angle.sin(), v * angle.cos() - u * angle.sin()
    moved = torch.exp(-(across**2) / 0.5) * torch.sigmoid(4 * (length - along.abs()))
    sharp = ((u == 0) & (v == 0)).float().expand(batch, 7, 7)
    pick = kind[:, None, None]
    kernel = torch.where(pick < 0.33, round_, torch.where(pick < 0.6, moved, sharp))
    kernel = kernel / kernel.sum((1, 2), keepdim=True)
    padded = F.pad(x, (3, 3, 3, 3), mode="replicate")
    return F.conv2d(padded.transpose(0, 1), kernel[:, None], groups=batch).transpose(0, 1)


def erased(x: torch.Tensor, generator, strength: float) -> torch.Tensor:
    """Every fifth image loses a rectangle."""
    for k in range(len(x)):
        if torch.rand((), generator=generator) < 0.2 * strength:
            h, w = (int(between(generator, 0.08, 0.3, 1) * side) for side in x.shape[2:])
            top = int(torch.randint(x.shape[2] - h, (), generator=generator))
            left = int(torch.randint(x.shape[3] - w, (), generator=generator))
            x[k, 0, top : top + h, left : left + w] = torch.rand((), generator=generator)
    return x
