"""The depth network: an encoder-decoder of plain 3x3 convolutions with skips and two heads.

Input   (B, 1, 192, 320), grey values 0 to 1 of the raw, distorted image.
Output  inverse depth (B, 1, 48, 80), 1/m, for the canonical camera of `camera.py`,
        u (B, 1, 48, 80) in (0, 1): scale of the Laplace distribution of the log-depth error.

The decoder ends at a quarter of the input's resolution; whoever reads a depth interpolates. See README.md for the reasons.
"""

import torch
from torch import nn
from torch.nn import functional as F

NEAREST_M = 0.2  # Inverse depth = sigmoid / NEAREST_M: bounded whatever the input.
LEAST_U = 0.01


def block(inputs: int, outputs: int, stride: int = 1, size: int = 3) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, size, stride, size // 2, bias=False),
        nn.BatchNorm2d(outputs),
        nn.ReLU(inplace=True),
    )


class Up(nn.Module):
    """Nearest-neighbour doubling, the skip beside it, two convolutions."""

    def __init__(self, inputs: int, skip: int, outputs: int):
        super().__init__()
        self.reduce = block(inputs, outputs)
        self.merge = block(outputs + skip, outputs)

    def forward(self, below: torch.Tensor, skip: torch.Tensor) -> torch.Tensor:
        below = F.interpolate(self.reduce(below), scale_factor=2, mode="nearest")
        return self.merge(torch.cat([below, skip], dim=1))


class DepthNetwork(nn.Module):
    def __init__(self, channels: tuple[int, ...] = (16, 32, 64, 96, 128, 128)):
        super().__init__()
        half, quarter, eighth, sixteenth, thirtysecond, sixtyfourth = channels
        self.to_half = block(1, half, stride=2, size=5)
        self.to_quarter = nn.Sequential(block(half, quarter, 2), block(quarter, quarter))
        self.to_eighth = nn.Sequential(block(quarter, eighth, 2), block(eighth, eighth))
        self.to_sixteenth = nn.Sequential(block(eighth, sixteenth, 2), block(sixteenth, sixteenth))
        self.to_thirtysecond = nn.Sequential(block(sixteenth, thirtysecond, 2), block(thirtysecond, thirtysecond))
        # 5 x 3 cells that see the whole image: where the scale of a scene is decided.
        self.to_sixtyfourth = nn.Sequential(block(thirtysecond, sixtyfourth, 2), block(sixtyfourth, sixtyfourth))
        self.up32 = Up(sixtyfourth, thirtysecond, 96)
        self.up16 = Up(96, sixteenth, 80)
        self.up8 = Up(80, eighth, 64)
        self.up4 = Up(64, quarter, 32)
        self.depth_head = nn.Sequential(block(32, 16), nn.Conv2d(16, 1, 3, padding=1))
        self.u_head = nn.Sequential(block(32, 16), nn.Conv2d(16, 1, 3, padding=1))
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, nonlinearity="relu")
        # Starts at 3 m and u = 0.25 everywhere.
        for head, start in ((self.depth_head, -2.6), (self.u_head, -1.1)):
            nn.init.normal_(head[-1].weight, std=0.01)
            nn.init.constant_(head[-1].bias, start)

    def logits(self, image: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        x2 = self.to_half((image - 0.45) * 4.0)
        x4 = self.to_quarter(x2)
        x8 = self.to_eighth(x4)
        x16 = self.to_sixteenth(x8)
        x32 = self.to_thirtysecond(x16)
        x64 = self.to_sixtyfourth(x32)
        # 48 x 80 halves to 3 x 5 exactly.
        y = self.up4(self.up8(self.up16(self.up32(x64, x32), x16), x8), x4)
        return self.depth_head(y), self.u_head(y)

    def log_depth_and_u(self, image: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """What the losses work with; log depth stays finite where the inverse depth underflows."""
        depth, u = (part.float() for part in self.logits(image))
        log_depth = -F.logsigmoid(depth) + torch.log(torch.tensor(NEAREST_M))
        return log_depth, LEAST_U + (1.0 - 2.0 * LEAST_U) * torch.sigmoid(u)

    def forward(self, image: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        depth, u = self.logits(image)
        return torch.sigmoid(depth) / NEAREST_M, LEAST_U + (1.0 - 2.0 * LEAST_U) * torch.sigmoid(u)


def folded(network: DepthNetwork) -> DepthNetwork:
    """A copy whose batch normalisations are folded into the convolutions before them."""
    import copy

    network = copy.deepcopy(network).eval()
    for module in network.modules():
        for name, child in list(module.named_children()):
            if isinstance(child, nn.Sequential) and len(child) == 3 and isinstance(child[1], nn.BatchNorm2d):
                fused = nn.utils.fusion.fuse_conv_bn_eval(child[0], child[1])
                setattr(module, name, nn.Sequential(fused, child[2]))
    return network


def unfolded(network: DepthNetwork, file, images: torch.Tensor) -> None:
    """Weights of an exported network. Its normalisations are gone, so new ones are put in that change nothing on these images."""
    import onnx

    model = onnx.load(str(file))
    weights = {entry.name: torch.from_numpy(onnx.numpy_helper.to_array(entry).copy()) for entry in model.graph.initializer}
    missing = [name for name, _ in folded(network).named_parameters() if name not in weights]
    if missing:
        raise SystemExit(f"{file}: has no {missing[0]}; it is no network of this kind")
    hooks = []

    def keep(norm, inputs, bias):
        mean, variance = inputs[0].mean((0, 2, 3)), inputs[0].var((0, 2, 3), unbiased=False)
        norm.running_mean.copy_(mean)
        norm.running_var.copy_(variance)
        norm.weight.copy_((variance + norm.eps).sqrt())
        norm.bias.copy_(mean + bias)

    with torch.no_grad():
        for name, module in network.named_modules():
            if isinstance(module, nn.Conv2d):
                module.weight.copy_(weights[f"{name}.weight"])
                if module.bias is not None:
                    module.bias.copy_(weights[f"{name}.bias"])
            elif isinstance(module, nn.BatchNorm2d):
                bias = weights[f"{name[: name.rindex('.')]}.0.bias"]
                hooks.append(module.register_forward_pre_hook(lambda norm, inputs, bias=bias: keep(norm, inputs, bias)))
        was = network.training
        network.eval()
        network(images)
        network.train(was)
    for hook in hooks:
        hook.remove()


def parameters(network: nn.Module) -> int:
    return sum(parameter.numel() for parameter in network.parameters())
