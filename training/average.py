#!/usr/bin/env python3
"""Averages the weights of a network and of what it became by further training, both exported.

    average.py --before ../host/models/indoor.onnx --after run/further.onnx --share 0.7 --out ../host/models/indoor.onnx

    w = (1 - share) w_before + share w_after

What is trained on further gets better at what it sees and forgets part of what it knew; on the line between the two most of both is kept
(Wortsman et al., Robust fine-tuning of zero-shot models, CVPR 2022). Normalisations are folded into the convolutions of both.
The .toml beside is that of `--after`, with its factor of u replaced when `--sigma-per-u` is given.
"""

import argparse
import re
from pathlib import Path

import onnx
from onnx import numpy_helper


def averaged(before: onnx.ModelProto, after: onnx.ModelProto, share: float) -> onnx.ModelProto:
    """The model `after` with weights between both. Raises ValueError where they are not the same network."""
    if not 0.0 <= share <= 1.0:
        raise ValueError(f"a share of {share} is not between 0 and 1")
    mixed = onnx.ModelProto()
    mixed.CopyFrom(after)
    old = {entry.name: numpy_helper.to_array(entry) for entry in before.graph.initializer}
    if set(old) != {entry.name for entry in mixed.graph.initializer}:
        raise ValueError("the two files are not exports of the same network")
    for entry in mixed.graph.initializer:
        new = numpy_helper.to_array(entry)
        if old[entry.name].shape != new.shape:
            raise ValueError(f"{entry.name} is {old[entry.name].shape} in one and {new.shape} in the other")
        if new.dtype.kind == "f":
            entry.CopyFrom(numpy_helper.from_array(((1 - share) * old[entry.name] + share * new).astype(new.dtype), entry.name))
    return mixed


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--before", type=Path, required=True)
    parser.add_argument("--after", type=Path, required=True)
    parser.add_argument("--share", type=float, required=True, help="of `--after`, 0 to 1")
    parser.add_argument("--sigma-per-u", type=float, help="sigma of log depth over u, from `evaluate.py --fit`")
    parser.add_argument("--out", type=Path, required=True)
    args = parser.parse_args()
    model = averaged(onnx.load(str(args.before)), onnx.load(str(args.after)), args.share)
    onnx.checker.check_model(model)
    card = args.after.with_suffix(".toml").read_text()
    if args.sigma_per_u is not None:
        card = re.sub(r"^sigma_per_u = .*$", f"sigma_per_u = {args.sigma_per_u:.3f}", card, flags=re.MULTILINE)
    onnx.save(model, str(args.out))
    args.out.with_suffix(".toml").write_text(card)


if __name__ == "__main__":
    main()
