"""`deepring export`: a trained network as ONNX."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from deepring.cli.map import network_of
from deepring.cli.report import console
from deepring.deployment.onnx import export_onnx
from deepring.errors import DeepringError


def export_command(arguments: Sequence[str]) -> None:
    """``deepring export CHECKPOINT -o FILE.onnx``."""
    parser = argparse.ArgumentParser(
        "deepring export",
        description="Write a trained DeepRING as ONNX: occupancy from above (batch, n, n) float32 "
        "in, descriptors (batch, θ, ω) out. What made it is in the file's metadata.",
    )
    parser.add_argument("checkpoint", type=Path, metavar="CHECKPOINT")
    parser.add_argument("-o", dest="output", type=Path, metavar="FILE", required=True)
    args = parser.parse_args(arguments)
    if args.output.exists():
        raise DeepringError(
            f"-o {args.output}: exists, expected a new file; nothing is overwritten: name another"
        )
    network = network_of(args.checkpoint)
    export_onnx(network, args.output)
    cells = network.raster.shape[0]
    console.print(f"written      {args.output}", markup=False)
    console.print(f"input        images (batch, {cells}, {cells}) float32, 0 or 1", markup=False)
    console.print("output       descriptors (batch, θ, ω) float32, unit norm", markup=False)
