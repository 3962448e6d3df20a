"""SemanticKITTI's classes, and which of several in one cell counts (Li et al., IROS 2021).

Source: the numbers of SemanticKITTI's label files and its 19 classes (Behley et al., ICCV 2019);
the order of classes is that of SSC's published code (lilin-hitcrt/SSC).
"""

import numpy as np
from numpy.typing import NDArray

from deepring.errors import DataError

#: The classes that are told apart, by their number; 0 is none of them.
CLASSES = (
    "none",
    "car",
    "bicycle",
    "motorcycle",
    "truck",
    "other vehicle",
    "person",
    "bicyclist",
    "motorcyclist",
    "road",
    "parking",
    "sidewalk",
    "other ground",
    "building",
    "fence",
    "vegetation",
    "trunk",
    "terrain",
    "pole",
    "traffic sign",
)

#: Number of the class of each label; labels that are not here are of no class. Moving things are of
#: the class of standing ones.
_OF_LABEL = {
    10: 1,
    11: 2,
    13: 5,  # bus
    15: 3,
    16: 5,  # on rails
    18: 4,
    20: 5,
    30: 6,
    31: 7,
    32: 8,
    40: 9,
    44: 10,
    48: 11,
    49: 12,
    50: 13,
    51: 14,
    60: 9,  # lane marking
    70: 15,
    71: 16,
    72: 17,
    80: 18,
    81: 19,
    252: 1,
    253: 7,
    254: 6,
    255: 8,
    256: 5,
    257: 5,
    258: 4,
    259: 5,
}

_CLASS_OF_LABEL = np.zeros(1 << 16, dtype=np.uint8)
_CLASS_OF_LABEL[list(_OF_LABEL)] = list(_OF_LABEL.values())

#: By class: of several in one cell that of the largest number counts; 0 never counts. Rare classes
#: that tell places apart come last, and things that move do not count.
PRIORITY = np.array(
    [0, 0, 0, 0, 0, 0, 0, 0, 0, 10, 11, 12, 13, 15, 16, 14, 17, 9, 18, 19], dtype=np.uint8
)

#: Classes in front of which nothing stands by accident: buildings, fences, trunks, poles, signs.
LANDMARKS = np.isin(np.arange(len(CLASSES)), (13, 14, 16, 18, 19))


def classes_of(labels: NDArray[np.floating]) -> NDArray[np.uint8]:
    """The classes (n,) of SemanticKITTI's labels (n,).

    Raises DataError for labels that are no whole numbers from 0 to 65535.

    >>> classes_of(np.array([0.0, 40, 50, 252])).tolist()
    [0, 9, 13, 1]
    """
    with np.errstate(invalid="ignore"):
        whole = (labels >= 0) & (labels < len(_CLASS_OF_LABEL)) & (labels == np.rint(labels))
    if not whole.all():
        raise DataError(
            f"points: a label {labels[~whole][0]:g}, expected whole numbers from 0 to 65535, as "
            "SemanticKITTI's label files have them"
        )
    return _CLASS_OF_LABEL[labels.astype(np.int64)]
