"""Describe and compare scans.

x
"""

print(1)
