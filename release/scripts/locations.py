"""Hold located.json, of `deepring localize --as json`, against the true poses of town/."""

import json
import math
from pathlib import Path

from deepring import open_session

drive = open_session("custom", "town/drive.yaml", "query")
true = {
    str(Path(file)): position for file, position in zip(drive.files, drive.positions, strict=True)
}
rows = json.loads(Path("located.json").read_text(encoding="utf-8"))["scans"]
trusted = [row for row in rows if row["trusted"]]
assert trusted, f"none of {len(rows)} locations is trusted"
for row in trusted:
    x, y = true[row["scan"]][:2]
    off = math.hypot(row["x"] - x, row["y"] - y)
    assert off < 2, f"{row['scan']} is trusted and {off:.1f} m off"
print(f"{len(trusted)} of {len(rows)} trusted, all within 2 m")
