#!/usr/bin/env python3
"""Writes the files of this folder: what PyTorch says of one made-up image, and small ONNX files with one thing wrong each.

    make.py --training ../../../training --indoor ../../../host/models/indoor.onnx --euroc euroc.pt

Needs training/requirements.txt; the weights are those that host/models were exported from, or an export itself, whose
weights are then put into PyTorch's network.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

HERE = Path(__file__).parent
WIDTH, HEIGHT = 320, 192


def image() -> np.ndarray:
    """Integers only, so that the test makes the same: a ramp, stripes that widen, and blocks."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.int64)
    blocks = ((x // 40) * 29 + (y // 32) * 53) % 97
    return ((x // 4 + y // 3 + (x * x // 64) % 32 + blocks) % 256).astype(np.uint8)


def references(training: Path, weights: dict[str, Path]):
    sys.path.insert(0, str(training))
    import torch
    from network import DepthNetwork, folded

    torch.set_num_threads(1)
    for name, path in weights.items():
        network = DepthNetwork()
        if path.suffix == ".onnx":
            network = folded(network)
            stored = onnx.load(str(path)).graph.initializer
            network.load_state_dict({entry.name: torch.from_numpy(numpy_helper.to_array(entry).copy()) for entry in stored}, strict=True)
        else:
            network.load_state_dict(torch.load(path, map_location="cpu", weights_only=True)["average"])
        network.eval()
        with torch.no_grad():
            parts = network(torch.from_numpy(image().astype(np.float32) / 255)[None, None])
        np.concatenate([part.numpy().ravel() for part in parts]).astype("<f4").tofile(HERE / f"{name}.f32")


def model(name, nodes, *, kind=TensorProto.FLOAT, shape=(1, 1, 32, 48), outputs=("depth",), opset=17, constants=(), out=(1, 1, 8, 12)):
    graph = helper.make_graph(
        nodes, "g", [helper.make_tensor_value_info("image", kind, shape)],
        [helper.make_tensor_value_info(o, kind, out) for o in outputs], list(constants),
    )
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", opset)], ir_version=8, producer_name="")
    (HERE / f"{name}.onnx").write_bytes(made.SerializeToString())


def pool(to="depth", source="image"):
    return helper.make_node("AveragePool", [source], [to], kernel_shape=[4, 4], strides=[4, 4])


def small():
    model("mean", [pool()])  # what it gives is the mean grey of 4 x 4 pixels
    model("both", [pool(), helper.make_node("Sigmoid", ["depth"], ["u"])], outputs=("depth", "u"))
    model("twice", [pool(), helper.make_node("Add", ["depth", "depth"], ["u"])], outputs=("depth", "u"))
    model("double", [pool()], kind=TensorProto.DOUBLE)
    model("colour", [pool()], shape=(1, 3, 32, 48), out=(1, 3, 8, 12))
    model("unsized", [pool()], shape=(1, 1, "h", "w"), out=(1, 1, "a", "b"))
    model("opset22", [pool()], opset=22)
    model("opset7", [pool()], opset=7)
    model("flat", [pool("p"), helper.make_node("Flatten", ["p"], ["depth"])], out=(1, 96))
    model("uneven", [pool(), helper.make_node("AveragePool", ["image"], ["u"], kernel_shape=[8, 8], strides=[8, 8])], outputs=("depth", "u"))
    model("not_finite", [helper.make_node("Log", ["image"], ["l"]), pool(source="l")])  # of black: minus infinity
    model("unknown_operator", [helper.make_node("Telepathy", ["image"], ["depth"])])
    loop = [helper.make_node("Add", ["image", "b"], ["a"]), helper.make_node("Add", ["a", "image"], ["b"]), pool(source="b")]
    model("loop", loop)
    offset = numpy_helper.from_array(np.zeros((1, 1, 32, 48), np.float32), "offset")
    offset.ClearField("raw_data")
    offset.data_location = TensorProto.EXTERNAL
    entry = offset.external_data.add()
    entry.key, entry.value = "location", "../secret.bin"
    model("external", [helper.make_node("Add", ["image", "offset"], ["a"]), pool(source="a")], constants=[offset])
    huge = numpy_helper.from_array(np.array([1, 1, 1 << 20, 1 << 20], np.int64), "shape")
    model("huge", [helper.make_node("Expand", ["one", "shape"], ["e"]), helper.make_node("ReduceMean", ["e"], ["m"], axes=[2, 3]),
                   helper.make_node("Add", ["image", "m"], ["a"]), pool(source="a")],
          constants=[huge, numpy_helper.from_array(np.ones((1, 1, 1, 1), np.float32), "one")])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--training", type=Path, required=True)
    parser.add_argument("--indoor", type=Path, required=True)
    parser.add_argument("--euroc", type=Path, required=True)
    args = parser.parse_args()
    references(args.training, {"indoor": args.indoor, "euroc": args.euroc})
    small()


if __name__ == "__main__":
    main()
