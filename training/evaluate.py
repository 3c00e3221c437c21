#!/usr/bin/env python3
"""Scores a network (weights or ONNX) against depths it has not seen, and prints one line per set.

    evaluate.py --model ../host/models/indoor.onnx --rooms ROOMS/test
    evaluate.py --model ../host/models/euroc.onnx --euroc V1_01_keyframes --split interleaved
    evaluate.py --model run/euroc.pt --euroc V1_01_keyframes --part choose --fit   # the factor of u

`factor` is ln (true / predicted) of an image as a whole, median over its pixels: mean over images, and how it varies between them.

Sets: rendered rooms and flights of other seeds; real keyframes kept out of training, against semi-global matching; semi-real sequences of
another renderer, exact; RGB-D images of another camera.
"""

import argparse
import json
import tomllib
from pathlib import Path

import numpy as np

import metrics
from data import Rooms, Stereo, rgbd, semi_real, simulated, split


def predictor(model: Path):
    """A function from images (N, 192, 320) uint8 to depth and u, (N, 48, 80)."""
    if model.suffix == ".onnx":
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1
        session = onnxruntime.InferenceSession(str(model), options, providers=["CPUExecutionProvider"])
        run = lambda image: session.run(["inverse_depth", "uncertainty"], {"image": image})
    else:
        import torch

        from network import DepthNetwork

        torch.set_num_threads(1)
        network = DepthNetwork()
        network.load_state_dict(torch.load(model, map_location="cpu", weights_only=True)["average"])
        network.eval()

        def run(image):
            with torch.no_grad():
                return [part.numpy() for part in network(torch.from_numpy(image))]

    def predict(images):
        inverse, u = zip(*(run((image[None, None] / np.float32(255)).astype(np.float32)) for image in images))
        return 1.0 / np.maximum(np.concatenate(inverse)[:, 0], 1e-4), np.concatenate(u)[:, 0]

    return predict


def sets(args):
    """Name, images and reference of everything asked for."""
    for folder in args.rooms:
        rooms = Rooms([folder])
        yield f"rooms {folder.name}", *rooms.take(np.arange(len(rooms)))
    for folder in args.simulated:
        yield f"flight {folder.name}", *simulated(folder)
    if args.euroc:
        stereo = Stereo(args.euroc, args.cache)
        indices = range(len(stereo.pairs)) if args.split == "all" else split(len(stereo.pairs), args.split)[args.part]
        yield f"{args.euroc.name} {args.split} {args.part}", *stereo.scored(indices)
    for folder in args.more:
        stereo = Stereo(folder, args.cache)
        yield folder.name, *stereo.scored(range(len(stereo.pairs)))
    for folder in args.semi_real:
        yield f"semi_real {folder.name}", *semi_real(folder, 40)
    if args.rgbd:
        yield args.rgbd.name, *rgbd(args.rgbd)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", type=Path, required=True)
    parser.add_argument("--rooms", type=Path, nargs="*", default=[])
    parser.add_argument("--euroc", type=Path)
    parser.add_argument("--split", default="interleaved", help="interleaved, contiguous or all")
    parser.add_argument("--part", default="score", choices=("score", "choose", "train"))
    parser.add_argument("--more", type=Path, nargs="*", default=[], help="EuRoC folders all of whose pairs are scored")
    parser.add_argument("--semi-real", type=Path, nargs="*", default=[])
    parser.add_argument("--simulated", type=Path, nargs="*", default=[], help="recordings of `libella simulate` with depth, each by itself")
    parser.add_argument("--rgbd", type=Path)
    parser.add_argument("--sigma-per-u", type=float, help="otherwise from the .toml beside the model, or 1.148 (Laplace)")
    parser.add_argument("--fit", action="store_true", help="also print the factor that calibrates this set")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--cache", type=Path, default=Path("run/cache"))
    args = parser.parse_args()
    predict = predictor(args.model)
    card = args.model.with_suffix(".toml")
    factor = args.sigma_per_u or (tomllib.loads(card.read_text())["sigma_per_u"] if card.exists() else metrics.laplace_quantile(0.6827))
    results = {}
    print(f"{args.model.name}, sigma of log depth = {factor:.3f} u")
    print("set                              n  AbsRel+-error (aligned)  RMSE  d<1.25 (aligned) const.  factor+-sigma  AUSE/random (pooled)  coverage 50 68 90 95")
    for name, images, reference in sets(args):
        depth, u = predict(images)
        f = metrics.depth_figures(depth, reference) | metrics.uncertainty_figures(depth, u, reference, factor)
        results[name] = f
        print(f"{name:30s} {f['images']:4d}  {f['abs_rel']:.3f}+-{f['abs_rel_error']:.3f} ({f['abs_rel_aligned']:.3f})    {f['rmse_m']:.2f}  {f['delta']:.3f} "
              f"({f['delta_aligned']:.3f})  {f['abs_rel_constant']:.2f}   {f['factor']:+.3f}+-{f['factor_sigma']:.3f}  {f['ause']:.3f}/{f['ause_random']:.3f}={f['ause_ratio']:.2f} ({f['ause_ratio_pooled']:.2f})  "
              f"{f['coverage_50']:.2f} {f['coverage_68']:.2f} {f['coverage_90']:.2f} {f['coverage_95']:.2f}", flush=True)
        if args.fit:
            f["sigma_per_u"] = metrics.fitted_sigma_per_u(depth, u, reference)
            print(f"    sigma_per_u = {f['sigma_per_u']:.3f}")
    if args.json:
        args.json.write_text(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
