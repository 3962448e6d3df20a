"""Place-recognition methods: scans become descriptors, and descriptors are compared."""

import inspect
from collections.abc import Iterator
from typing import Any, NamedTuple, Protocol, Self, cast, get_type_hints, runtime_checkable

import torch
from jaxtyping import Float, Float64, Shaped
from torch import Tensor

from deepring.errors import FileError
from deepring.io.typed import typed_values
from deepring.methods.given import check_calls
from deepring.methods.registry import method_class
from deepring.progress import Progress
from deepring.rasters import Raster, make_raster
from deepring.search.compare_index import CompareIndex
from deepring.search.hits import Index
from deepring.search.search_settings import SearchSettings
from deepring.text import shown


class Comparison(NamedTuple):
    """Queries against a database."""

    score: Float[Tensor, "q d"]
    """(q, d) float; higher is more alike."""
    turn: Float[Tensor, "q d"] | None
    """(q, d) float32 radians, the turn of the points from entry to query; None if not known."""


@runtime_checkable
class Method(Protocol):
    """A place-recognition method. Every method is evaluated through these calls alone.

    A method may offer more, each looked for where it is needed:

    - ``index(settings=None)``: an index that finds what `compare` finds, see `index_of`;
    - ``from_fingerprint(made_by)``, a classmethod: see `rebuild_method`;
    - ``descriptor_shape``: the shape of one descriptor; files with others are refused;
    - ``turn_period``, radians: what its turns are known modulo; 2π without it;
    - ``relative_poses(query, places)``: how one scan lies in the frame of another, see
      `RelativePoses`;
    - ``onnx_form()``: see `deepring.methods.onnx_file`.
    """

    @property
    def raster(self) -> Raster:
        """The image of a scan that the method describes; it is what the cache holds."""
        ...

    def describe(
        self, rasters: Shaped[Tensor, " batch *raster"]
    ) -> Float[Tensor, " batch *descriptor"]:
        """Descriptors (b, ...) of rasters (b, *raster.shape)."""
        ...

    def compare(
        self, queries: Float[Tensor, " q *descriptor"], database: Float[Tensor, " d *descriptor"]
    ) -> Comparison:
        """Compare descriptors (q, ...) with descriptors (d, ...)."""
        ...


@runtime_checkable
class RelativePoses(Protocol):
    """A `Method` that also tells how its best candidates lie in the frame of the query.

    >>> from deepring.methods.ssc import Ssc
    >>> isinstance(Ssc(), RelativePoses)
    True
    """

    def relative_poses(
        self, query: Shaped[Tensor, " *raster"], places: Shaped[Tensor, " k *raster"]
    ) -> Float64[Tensor, "k 4 4"]:
        """Rigid transforms that carry each place's points onto the query's.

        ``transform[:3, :3] @ point + transform[:3, 3]`` of a place's point, in metres, is where the
        query sees it. Both frames are those of the rasters' points: the sensor's axes, z above
        the ground under it. A scan that is turned before it is rasterized counts as it is turned.

        Args:
            query: raster of one scan, *raster.shape.
            places: rasters (k, *raster.shape), on any device.

        Returns:
            (k, 4, 4) float64 on the CPU; NaN throughout where a pose cannot be told. A method that
            knows x, y and heading alone leaves z, roll and pitch as they are.
        """
        ...


class FixedMethod:
    """Base of methods that learn nothing: made of a raster and of plain keyword values.

    Those values are the object's public attributes, and with the raster its fingerprint. Its
    ``describe`` and ``compare`` take whatever is like their arrays, and raise DataError otherwise.
    """

    raster: Raster

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        check_calls(cls)

    @classmethod
    def from_fingerprint(cls, made_by: dict[str, Any]) -> Self:
        """The method that a `deepring.evaluation.fingerprint.fingerprint` is of.

        Raises ConfigError for values that the method does not have, and of other types.
        """
        hints = get_type_hints(cls.__init__)
        names = [name for name in inspect.signature(cls).parameters if name != "raster"]
        known = {name: hints.get(name, Any) for name in names}
        values = typed_values(known, made_by.get("values"), "made_by.values")
        return cls(make_raster(made_by.get("raster", {})), **values)  # type: ignore[call-arg]


class Images(Protocol):
    """A tensor, or `Rasters` that unpack what is asked for."""

    def __len__(self) -> int: ...
    def __getitem__(self, rows: slice, /) -> Tensor: ...


def describe_all(
    method: Method,
    images: Images,
    batch: int = 64,
    device: torch.device | None = None,
    progress: Progress | None = None,
) -> Float[Tensor, " n *descriptor"]:
    """Descriptors (n, ...) of n images, ``batch`` in memory at a time, made on ``device``."""
    return torch.cat(list(describe_batches(method, images, batch, device, progress)))


def describe_batches(
    method: Method,
    images: Images,
    batch: int = 64,
    device: torch.device | None = None,
    progress: Progress | None = None,
) -> Iterator[Tensor]:
    """`describe_all` batch by batch, each made when it is asked for.

    ``progress`` is called when the next batch is asked for, so that it counts the work on the one
    before.
    """
    for k in range(0, len(images), batch):
        yield method.describe(images[k : k + batch].to(device))
        if progress is not None:
            progress(min(k + batch, len(images)), len(images))


def index_of(method: Method, settings: SearchSettings | None = None) -> Index:
    """An empty index whose scores and turns are those of ``method.compare``.

    It is the method's own. A method without ``index``, and a subclass that compares otherwise
    than the class whose ``index`` it inherits, is searched exhaustively by its ``compare``.
    ``settings`` are those of a search by correlation; other indexes take no notice.
    """
    classes = type(method).__mro__
    depth = next((k for k, cls in enumerate(classes) if "index" in vars(cls)), len(classes))
    if any("compare" in vars(cls) for cls in classes[:depth]):
        return CompareIndex(method)
    index: Index = cast("Any", method).index(settings)
    return index


def rebuild_method(made_by: dict[str, Any], own_class: str | type | None = None) -> Method:
    """A method that compares the descriptors that a fingerprint is of, and describes none.

    A network's weights are not known here: they are on the device 'meta', where nothing can be
    computed with them. ``own_class`` is that of `deepring.methods.registry.method_class`.

    Raises:
        ConfigError: a name that is not registered.
        FileError: a method without ``from_fingerprint``, or a fingerprint that this version of
            the code does not make the same method of.
    """
    name = str(made_by.get("method"))
    cls: Any = method_class(name, own_class)
    if not hasattr(cls, "from_fingerprint"):
        raise FileError(
            f"made_by.method: {name!r} cannot be rebuilt, expected a class with from_fingerprint; "
            "score its descriptors with score_descriptors in Python"
        )
    try:
        method: Method = cls.from_fingerprint(made_by)
    except (TypeError, KeyError, AttributeError) as error:
        raise FileError(
            f"made_by: {name!r} cannot be made of {shown(made_by)}; expected the values of this "
            "version's class; export again"
        ) from error
    return method
