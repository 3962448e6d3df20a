"""`deepring schema`: the JSON schemas of what commands print and of drive.yaml."""

import argparse

from deepring.schemas import read_schema, schema_names, schema_text


def schema_command(args: argparse.Namespace) -> None:
    """Print a schema as its file holds it; without a name, the names of all."""
    if args.name is None:
        print("\n".join(schema_names()))
        return
    read_schema(args.name)  # says which names there are
    print(schema_text(args.name), end="")
