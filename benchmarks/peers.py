"""deepring beside map-closures, kiss-matcher and small_gicp, on the same data in one run.

    make peers PEERS='kitti=FOLDER sim_nclt=FOLDER'      # in an environment of its own
    python benchmarks/peers.py [DATA=FOLDER ...] [--pairs 60] [--only loops]

Without data a small campus is simulated. Writes peers.md, loops.csv and pairs.csv; what is compared
and how is said in docs/peers.md, in peer_loops.py and in peer_pairs.py. Peers that are not
installed are named and left out. Everything runs on one core, and times are processor times.
"""

import argparse
import importlib.metadata
import importlib.util
import os
from pathlib import Path

import torch
from peer_loops import measured_loops
from peer_pairs import measured_pairs
from peer_table import markdown, write_csv
from timing import machine

from deepring.cli.process import tune_process
from deepring.errors import DeepringError
from deepring.io.files import replacing
from deepring.methods.network_file import load_network
from deepring.simulation.presets import preset, with_knobs
from deepring.simulation.simulate import simulate

#: Package, and the module that it brings.
PEERS = {
    "map-closures": "map_closures",
    "kiss-matcher": "kiss_matcher",
    "small_gicp": "small_gicp",
}


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", nargs="*", metavar="DATA=FOLDER")
    parser.add_argument("--pairs", type=int, default=60, help="of each distance")
    parser.add_argument("--only", choices=("loops", "pairs"))
    parser.add_argument("--checkpoint", default="shipped")
    parser.add_argument("-o", "--output", type=Path, default=Path("outputs/peers"))
    args = parser.parse_args(arguments)
    if args.pairs < 1:
        parser.error(f"--pairs: {args.pairs}, expected at least 1")
    for item in args.data:
        if "=" not in item:
            parser.error(f"{item}: expected DATA=FOLDER, as in kitti=FOLDER or sim_nclt=FOLDER")
    one_core()
    print(said(), flush=True)
    network = load_network(args.checkpoint).method
    data = [item.split("=", 1) for item in args.data] or [["sim_nclt", simulated(args.output)]]
    loops, pairs = [], []
    for name, root in data:
        if args.only != "pairs":
            loops += shown(measured_loops(name, root, network))
            write_csv(args.output / "loops.csv", loops)
        if args.only != "loops":
            pairs += shown(measured_pairs(name, root, network, args.pairs))
            write_csv(args.output / "pairs.csv", pairs)
        text = "\n\n".join([said(), *(markdown(rows) for rows in (loops, pairs) if rows)]) + "\n"
        with replacing(args.output / "peers.md") as part:
            part.write_text(text, encoding="utf-8")


def shown(rows: list) -> list:
    print(f"\n{markdown(rows)}", flush=True)
    return rows


def one_core() -> None:
    """Some peers start as many threads as there are cores."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    torch.set_num_threads(1)
    tune_process()


def simulated(output: Path) -> str:
    """A small campus that is driven twice."""
    settings = with_knobs(preset("nclt", 0), {"train_columns": 2, "test_columns": 2})
    return str(simulate(settings, output / "sim_nclt", workers=1))


def said() -> str:
    """What was compared, where, and what was missing."""
    present, absent = [], []
    for package, module in PEERS.items():
        if importlib.util.find_spec(module) is None:
            absent.append(package)
        else:
            present.append(f"{package} {importlib.metadata.version(package)}")
    lines = [f"deepring beside {', '.join(present) or 'nothing'}"]
    if absent:
        lines.append(f"absent: {', '.join(absent)}; run make peers")
    where = machine(threads=1, device="cpu")
    lines.append(", ".join(f"{key} {value}" for key, value in where.items()))
    return "\n\n".join(lines)


if __name__ == "__main__":
    try:
        main()
    except DeepringError as error:
        raise SystemExit(str(error)) from None
