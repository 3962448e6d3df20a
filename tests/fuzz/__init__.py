"""Files of every format, damaged and forged: each is read right, or refused in one line.

`python -m fuzz` runs the suite, with `tests/` on the Python path; `make fuzz` does that.
"""
