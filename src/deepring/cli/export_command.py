"""`deepring export`: a trained network as ONNX, or as weights without anything of the training."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from deepring.cli.console import console
from deepring.cli.map_command import expect_new, network_of
from deepring.errors import DeepringError
from deepring.methods.checkpoint import load_network
from deepring.methods.network_file import write_network
from deepring.methods.onnx_file import export_onnx


def export_command(arguments: Sequence[str]) -> None:
    """``deepring export CHECKPOINT -o FILE.onnx`` or ``FILE.safetensors``."""
    parser = argparse.ArgumentParser(
        "deepring export",
        description="Write a trained DeepRING as .onnx: occupancy from above (batch, n, n) float32 "
        "in, descriptors (batch, θ, ω) out; or any trained network as .safetensors, which all "
        "commands take as a checkpoint. What made it is in the file's metadata.",
    )
    parser.add_argument("checkpoint", metavar="CHECKPOINT", help="a .ckpt, or 'shipped'")
    parser.add_argument("-o", dest="output", type=Path, metavar="FILE", required=True)
    args = parser.parse_args(arguments)
    expect_new(args.output)
    if args.output.suffix == ".safetensors":
        write_network(args.output, load_network(args.checkpoint))
        console.print(f"written      {args.output}", markup=False)
        return
    if args.output.suffix != ".onnx":
        raise DeepringError(f"-o {args.output}: expected a name in .onnx or .safetensors")
    network = network_of(args.checkpoint)
    export_onnx(network, args.output)
    cells = network.raster.shape[0]
    console.print(f"written      {args.output}", markup=False)
    console.print(f"input        images (batch, {cells}, {cells}) float32, 0 or 1", markup=False)
    console.print("output       descriptors (batch, θ, ω) float32, unit norm", markup=False)
