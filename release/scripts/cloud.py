"""Write the scans of town/ as one cloud, city.laz, and the way that was driven, city.tum."""

import laspy
import numpy as np

from deepring import open_session

drive = open_session("custom", "town/drive.yaml", "map")
clouds, rows = [], []
for k in range(0, len(drive), 3):
    pose = drive.poses[k]
    clouds.append(drive.points(k) @ pose[:3, :3].T + pose[:3, 3])
    rows.append([k, *pose[:3, 3], 0, 0, 0, 1])
points = np.concatenate(clouds)
cloud = laspy.create(point_format=0, file_version="1.2")
cloud.header.scales, cloud.header.offsets = [0.01] * 3, [0.0] * 3
cloud.x, cloud.y, cloud.z = points.T
cloud.write("city.laz")
np.savetxt("city.tum", rows)
