#!/usr/bin/env python3
"""Trains the depth network; see README.md for the recipe.

    train.py --config config/indoor.toml --rooms ROOMS/* --out run/indoor.pt
    train.py --config config/euroc.toml --start run/indoor.pt --rooms ROOMS/* --euroc V1_01_keyframes --more MH_01_easy --out run/euroc.pt

What it writes can be trained on (`--start`), resumed after an interruption (`--out` exists), scored and exported. `--start` also takes
an exported network.
"""

import argparse
import copy
import math
import time
import tomllib
from pathlib import Path

import numpy as np
import torch

import augment
import losses
from data import Rooms, Stereo, split
from network import DepthNetwork, parameters, unfolded
from photometric import PhotometricSource


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--config", type=Path, required=True)
    parser.add_argument("--rooms", type=Path, nargs="*", default=[],
                        help="folders written by `libella rooms`; one that is named twice is drawn twice as often, one not finished yet is taken in later")
    parser.add_argument("--euroc", type=Path, help="EuRoC stereo keyframes that are split into training and scoring")
    parser.add_argument("--more", type=Path, nargs="*", default=[], help="EuRoC folders all of whose pairs train")
    parser.add_argument("--split", default="interleaved", help="interleaved, contiguous or all")
    parser.add_argument("--start", type=Path, help="weights to start from, .pt or .onnx")
    parser.add_argument("--cache", type=Path, default=Path("run/cache"), help="where matched depths are kept")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--steps", type=int, help="instead of the configured number")
    parser.add_argument("--minutes", type=float, help="ends after this time if it is short of the steps; the rate falls accordingly")
    parser.add_argument("--seed", type=int)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--bf16", action="store_true", help="convolve in half width: twice as fast where the processor has it")
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    return parser.parse_args()


def real_arrays(args, config, seed):
    """Turned copies of the pairs that may be trained on."""
    copies = config["data"].get("copies", 12)
    generator = np.random.default_rng(seed)
    images, depths = [], []
    if args.euroc:
        stereo = Stereo(args.euroc, args.cache)
        indices = range(len(stereo.pairs)) if args.split == "all" else split(len(stereo.pairs), args.split)["train"]
        parts = stereo.turned(indices, copies, generator)
        images.append(parts[0])
        depths.append(parts[1])
    for folder in args.more:
        stereo = Stereo(folder, args.cache)
        # A share of the copies: these pairs look at another place.
        parts = stereo.turned(range(len(stereo.pairs)), max(1, round(copies * config["data"].get("more_share", 0.3))), generator)
        images.append(parts[0])
        depths.append(parts[1])
    if not images:
        return None
    return np.concatenate(images), np.concatenate(depths)


def learning_rate(done: float, warm: float) -> float:
    """Share of the peak's rate after this share of the run; up to `warm` after a (re)start."""
    return min(1.0, warm) * (0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * min(1.0, done))))


def main():
    args = arguments()
    config = {"data": {}} | tomllib.loads(args.config.read_text())
    options = config["train"]
    steps = args.steps or options["steps"]
    seed = options["seed"] if args.seed is None else args.seed
    batch, device = options["batch"], torch.device(args.device)
    torch.set_num_threads(args.threads)
    torch.manual_seed(seed)
    generator = torch.Generator().manual_seed(seed)
    draw = np.random.default_rng(seed)

    rooms = Rooms(args.rooms) if args.rooms else None
    network = DepthNetwork()
    if args.start and args.start.suffix == ".onnx":
        if rooms is None:
            raise SystemExit("an .onnx to start from needs --rooms: its normalisations are found anew on them")
        views = torch.from_numpy(rooms.take(draw.integers(0, len(rooms), 64))[0])[:, None].float() / 255
        unfolded(network, args.start, augment.photometric(views, generator, options.get("strength", 1.0)))
    elif args.start:
        network.load_state_dict(torch.load(args.start, map_location="cpu", weights_only=True)["average"])
    network = network.to(device, memory_format=torch.channels_last)
    average = copy.deepcopy(network)
    optimizer = torch.optim.AdamW(network.parameters(), weight_decay=options.get("weight_decay", 1e-2), fused=True)
    first, spent = 0, 0.0
    if args.out.exists():
        stored = torch.load(args.out, map_location=device, weights_only=True)
        if stored["step"] >= steps:
            raise SystemExit(f"{args.out}: has all {steps} steps; give another --out or more --steps")
        network.load_state_dict(stored["network"])
        average.load_state_dict(stored["average"])
        optimizer.load_state_dict(stored["optimizer"])
        first, spent = stored["step"], stored["seconds"]
        generator.manual_seed(seed + first)
        draw = np.random.default_rng(seed + first)
        print(f"goes on at step {first}, {spent:.0f} s")

    real = real_arrays(args, config, seed)
    sequences = [PhotometricSource(folder, args.split if folder == args.euroc else "all") for folder in
                 ([args.euroc] if args.euroc else []) + args.more] if options.get("photometric", 0) > 0 else []
    if rooms is None and real is None:
        raise SystemExit("nothing to train on: give --rooms or --euroc")
    share = 1.0 if real is None else 0.0 if rooms is None else config["data"].get("rooms_share", 0.4)
    from_rooms = round(share * batch)
    print(f"{parameters(network)} parameters, {len(rooms) if rooms else 0} room views, {len(real[0]) if real else 0} real views, "
          f"{from_rooms} + {batch - from_rooms} per batch, {steps} steps", flush=True)
    weights = tuple(options.get("weights", (1.0, 0.5, 1.0, 0.0)))
    strength = options.get("strength", 1.0)
    limit = 60 * args.minutes if args.minutes else math.inf
    began, sums = time.time() - spent, []
    network.train()
    if options.get("freeze_statistics", False):
        for module in network.modules():
            if isinstance(module, torch.nn.BatchNorm2d):
                module.eval()
    args.out.parent.mkdir(parents=True, exist_ok=True)

    def save(step):
        partial = args.out.with_suffix(".partial")
        torch.save({"network": network.state_dict(), "average": average.state_dict(), "optimizer": optimizer.state_dict(),
                    "step": step, "seconds": time.time() - began}, partial)
        partial.replace(args.out)

    for step in range(first, steps):
        parts = []
        if from_rooms:
            parts.append(rooms.take(draw.integers(0, len(rooms), from_rooms)))
        if batch > from_rooms:
            pick = draw.integers(0, len(real[0]), batch - from_rooms)
            parts.append((real[0][pick], real[1][pick]))
        image = torch.from_numpy(np.concatenate([p[0] for p in parts]))[:, None].float() / 255
        depth = torch.from_numpy(np.concatenate([p[1] for p in parts]))[:, None]
        image, depth = augment.mirrored(image, depth, generator)
        image = augment.photometric(image, generator, strength)
        image, depth = image.to(device, memory_format=torch.channels_last), depth.to(device)
        with torch.autocast(device.type, torch.bfloat16, enabled=args.bf16):
            log_depth, u = network.log_depth_and_u(image)
        loss = losses.supervised(log_depth, u, depth, weights) + 1e-3 * losses.smoothness(log_depth, image)
        if sequences:
            loss = loss + options["photometric"] * sequences[step % len(sequences)].loss(network, draw, options.get("photometric_batch", 4), device)
        done = max(step / steps, (time.time() - began) / limit)
        for group in optimizer.param_groups:
            group["lr"] = options["rate"] * learning_rate(done, (step - first + 1) / options.get("warmup", 100))
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimizer.step()
        decay = min(options.get("average", 0.998), (step + 1) / (step + 10))
        with torch.no_grad():
            for slow, fast in zip(average.state_dict().values(), network.state_dict().values()):
                if slow.dtype.is_floating_point:
                    slow.lerp_(fast, 1 - decay)
                else:
                    slow.copy_(fast)
        with torch.no_grad():
            known = depth > 0
            sums.append((loss.item(), (torch.exp(log_depth) / depth - 1)[known].abs().mean().item()))
        over = step + 1 == steps or done >= 1.0
        if (step + 1) % 100 == 0 or over:
            mean = np.mean(sums, 0)
            print(f"step {step + 1} loss {mean[0]:.4f} abs_rel {mean[1]:.4f} {time.time() - began:.0f} s", flush=True)
            sums = []
        if (step + 1) % 500 == 0:
            save(step + 1)
            if rooms and rooms.more():
                print(f"{len(rooms)} room views", flush=True)
        if over:
            break
    save(steps)


if __name__ == "__main__":
    main()
