"""`deepring export`: a trained network as ONNX, or its weights and settings alone."""

import argparse

from deepring.cli.json_output import show_written
from deepring.cli.options import expect_new
from deepring.errors import ConfigError
from deepring.text import printable


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
    _say(args)


def _export_onnx(args: argparse.Namespace) -> None:
    from deepring.methods.network_file import load_network
    from deepring.methods.onnx_file import export_onnx

    network = load_network(args.checkpoint, args.method).method
    export_onnx(network, args.output)
    shape = ", ".join(str(length) for length in network.raster.shape)
    _say(
        args,
        f"input        images (batch, {shape}) float32",
        "output       descriptors (batch, ...) float32",
    )


def _say(args: argparse.Namespace, *further: str) -> None:
    lines = "\n".join([f"written      {printable(str(args.output))}", *further])
    show_written(args, [args.output], lambda: print(lines))
