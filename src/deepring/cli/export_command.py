"""`deepring export`: a trained network as ONNX, or its weights and settings alone."""

import argparse

from deepring.cli.console import console
from deepring.cli.options import expect_new
from deepring.errors import ConfigError


def export_command(args: argparse.Namespace) -> None:
    """Write the network of a checkpoint in the format that the new file's ending names."""
    expect_new(args.output)
    if args.output.suffix == ".safetensors":
        _export_weights(args)
    elif args.output.suffix == ".onnx":
        _export_onnx(args)
    else:
        raise ConfigError(
            f"output: {args.output}, expected a name that ends in .onnx or .safetensors"
        )


def _export_weights(args: argparse.Namespace) -> None:
    from deepring.methods.network_file import load_network, write_network

    write_network(args.output, load_network(args.checkpoint, args.method))
    console.print(f"written      {args.output}")


def _export_onnx(args: argparse.Namespace) -> None:
    from deepring.methods.network_file import load_network
    from deepring.methods.onnx_file import export_onnx

    network = load_network(args.checkpoint, args.method).method
    export_onnx(network, args.output)
    shape = ", ".join(str(length) for length in network.raster.shape)
    console.print(f"written      {args.output}")
    console.print(f"input        images (batch, {shape}) float32")
    console.print("output       descriptors (batch, ...) float32")
