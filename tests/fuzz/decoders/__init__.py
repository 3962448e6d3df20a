"""Independent decoders: plain loops written from the formats' definitions.

Nothing of the package and no library of arrays is used. Points are lists of [x, y, z], each value
rounded to float32; missing returns (NaN, infinite, all zero) are left out.
"""
