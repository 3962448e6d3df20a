"""`deepring train` as a script file: Lightning starts it for each further process of a DDP run.

Python puts the folder of a script before all others. This one holds no module whose name is that of
another, as a `warnings.py` beside the commands would be.
"""

import os
import sys

if __name__ == "__main__":
    paths = os.environ.get("DEEPRING_DDP_PATHS")
    sys.path[:] = sys.path[1:] if paths is None else paths.split(os.pathsep)
    from deepring.cli.main import main

    main(["train", *sys.argv[1:]])
