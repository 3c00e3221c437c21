#!/usr/bin/env python3
"""Writes weights as ONNX (opset 17, fixed shapes, batch normalisation folded) with a .toml beside it, and checks the file:
onnxruntime must agree with PyTorch to 1e-4 on images with and without structure.

    export.py --weights run/indoor.pt --out ../host/models/indoor.onnx --sigma-per-u 1.1
"""

import argparse
import warnings
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import torch

from camera import CANONICAL, HEIGHT, WIDTH
from network import DepthNetwork, folded, parameters

TOLERANCE = 1e-4
OPERATORS = {"Conv", "Relu", "Resize", "Concat", "Sigmoid", "Add", "Sub", "Mul", "Div", "Constant"}

CARD = """# What `{name}` takes and gives; its model card is `{stem}.md`.
[input]
name = "image"          # 1 x 1 x {height} x {width}, f32, grey values 0 to 1 of the raw, distorted image
# fx / width, fy / height, (cx + 1/2) / width, (cy + 1/2) / height of the camera that depths are meant for
normalised_intrinsics = [{intrinsics}]
distortion = [{distortion}]  # radial-tangential k1 k2 p1 p2

[depth]
name = "inverse_depth"  # 1 x 1 x {rows} x {columns}, 1/m along the optical axis; its pixel (i, j) lies at (4 i + 1.5, 4 j + 1.5)
kind = "inverse"

[uncertainty]
name = "uncertainty"    # the same shape, u in (0, 1)
"""


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--weights", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--sigma-per-u", type=float, required=True, help="sigma of log depth over u, from `evaluate.py --part choose --fit`")
    args = parser.parse_args()
    torch.set_num_threads(1)
    network = DepthNetwork()
    network.load_state_dict(torch.load(args.weights, map_location="cpu", weights_only=True)["average"])
    network.eval()
    plain = folded(network).eval()
    args.out.parent.mkdir(parents=True, exist_ok=True)
    example = torch.rand(1, 1, HEIGHT, WIDTH, generator=torch.Generator().manual_seed(0))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        torch.onnx.export(plain, (example,), str(args.out), input_names=["image"], output_names=["inverse_depth", "uncertainty"],
                          opset_version=17, dynamo=False)
    model = onnx.load(str(args.out))
    onnx.checker.check_model(model)
    used = {node.op_type for node in model.graph.node}
    if not used <= OPERATORS:
        raise SystemExit(f"{args.out}: operators {sorted(used - OPERATORS)} are not among those that tract is known to run well")
    text = CARD.format(
        name=args.out.name, stem=args.out.stem, height=HEIGHT, width=WIDTH, rows=HEIGHT // 4, columns=WIDTH // 4,
        intrinsics=", ".join(f"{v:.6f}" for v in CANONICAL.normalised), distortion=", ".join(f"{v:.8f}" for v in CANONICAL.distortion),
    )
    args.out.with_suffix(".toml").write_text(
        f"# sigma of log depth = sigma_per_u * u, for initialising landmarks and gating\nsigma_per_u = {args.sigma_per_u:.3f}\n\n" + text
    )
    session = onnxruntime.InferenceSession(str(args.out), providers=["CPUExecutionProvider"])
    draw = np.random.default_rng(1)
    ramp = np.linspace(0, 1, WIDTH, dtype=np.float32)[None].repeat(HEIGHT, 0)
    images = [draw.random((HEIGHT, WIDTH), dtype=np.float32), ramp, np.zeros_like(ramp), np.ones_like(ramp), np.kron(draw.random((12, 20)), np.ones((16, 16))).astype(np.float32)]
    worst = 0.0
    for image in images:
        with torch.no_grad():
            expected = [part.numpy() for part in network(torch.from_numpy(image)[None, None])]
        got = session.run(["inverse_depth", "uncertainty"], {"image": image[None, None]})
        worst = max(worst, *(float(abs(a - b).max()) for a, b in zip(expected, got)))
        if not all(np.isfinite(part).all() for part in got):
            raise SystemExit(f"{args.out}: gives what is no finite number")
    size = args.out.stat().st_size
    print(f"{args.out.name}: {parameters(plain)} parameters, {size / 2**20:.2f} MiB, {sorted(used)}, "
          f"onnxruntime and PyTorch differ by {worst:.1e} at most")
    if worst > TOLERANCE or size > 10 * 2**20:
        raise SystemExit("that is too much")


if __name__ == "__main__":
    main()
