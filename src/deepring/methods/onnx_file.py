"""A trained network as ONNX: rasters in, descriptors out.

A network that can be exported has ``onnx_form()``: a module of the same output whose operators
every runtime has.
"""

import json
import logging
import warnings
from pathlib import Path
from typing import Any

import torch
from packaging.version import Version

from deepring.errors import ConfigError
from deepring.io.files import replacing
from deepring.methods.network import NetworkMethod
from deepring.methods.network_file import describe_network

#: Of the operators used.
OPSET = 18

#: The first torch that exports batches of any size; 2.5 and 2.6 fail or crash.
FIRST_TORCH = "2.7"

_INSTALL = "pip install 'deepring[onnx]'"


def export_onnx(network: NetworkMethod, path: Path | str) -> None:
    """Write the network as ONNX, whole or not at all; what made it is in its metadata.

    Input 'images' (batch, *raster.shape) float32; output 'descriptors' (batch, ...) float32.

    Raises:
        ConfigError: a network without an ONNX form, or with settings that it does not take; the
            package onnx is missing, or torch is too old.
    """
    make_form = getattr(network, "onnx_form", None)
    if not callable(make_form):
        raise ConfigError(
            f"onnx: {network.settings.label} has no ONNX form, expected a method with "
            "onnx_form(), such as DeepRING; export it as .safetensors"
        )
    try:
        import onnx
    except ImportError:
        raise ConfigError(f"onnx: the package onnx is not installed; {_INSTALL}") from None
    if Version(torch.__version__) < Version(FIRST_TORCH):
        raise ConfigError(
            f"onnx: torch {torch.__version__} cannot export it, expected {FIRST_TORCH} or later; "
            f"{_INSTALL}"
        )
    form = make_form().eval()
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)  # it misses torchvision; we do not
    example = torch.zeros(2, *network.raster.shape)
    batch = torch.export.Dim("batch", min=1, max=2**31 - 1)  # torch 2.7 crashes without a maximum
    with replacing(path) as temporary, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the exporter about itself
        program = torch.onnx.export(
            form,
            (example,),
            input_names=["images"],
            output_names=["descriptors"],
            dynamic_shapes={"images": {0: batch}},
            opset_version=OPSET,
            dynamo=True,
            verbose=False,
        )
        assert program is not None
        model: Any = program.model_proto
        onnx.helper.set_model_props(model, {"deepring": json.dumps(describe_network(network))})
        onnx.checker.check_model(model)
        onnx.save_model(model, str(temporary))
