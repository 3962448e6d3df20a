"""Write the network that comes with the package anew, with the same weights, in today's format.

    python tools/rewrite_weights.py

Run it when the format of network files or the description of networks changes. The settings are
those that the file has, whichever of its formats it is in.
"""

import json
from pathlib import Path

from safetensors import safe_open

import deepring.methods
from deepring.methods.deepring import DeepRing, DeepRingSettings
from deepring.methods.network_file import TrainedNetwork, read_network, write_network

FILE = Path(deepring.methods.__file__).parent / "weights" / "deepring.safetensors"


def main() -> None:
    """Read the file without its own reader, and write it."""
    with safe_open(FILE, framework="pt") as file:
        metadata = file.metadata()
        weights = {name: file.get_tensor(name).clone() for name in sorted(file.keys())}
    old = "deepring_network" in metadata
    header = json.loads(
        metadata["deepring_network"] if old else metadata["deepring_sealed"].splitlines()[1]
    )
    header = header if old else header["values"]
    network = DeepRing(DeepRingSettings.from_dict(header["network"]["settings"]))
    network.load_state_dict(weights)
    write_network(FILE, TrainedNetwork(network.eval(), header["trained_on"], header["loss"]))
    again = read_network(FILE)
    assert (again.trained_on, again.loss) == (header["trained_on"], header["loss"])
    assert all((again.method.state_dict()[name] == value).all() for name, value in weights.items())
    print(f"{FILE}: {len(weights)} tensors, {FILE.stat().st_size} bytes")


if __name__ == "__main__":
    main()
