"""`deepring train` as a script file: Lightning starts it for each further process of a DDP run."""

import sys

from deepring.cli.main import main

if __name__ == "__main__":
    main(["train", *sys.argv[1:]])
