"""Networks whose descriptor is a vector, compared by Euclidean distance."""

from jaxtyping import Float
from torch import Tensor

from deepring.core.similarity import negative_distance
from deepring.methods.method import Comparison
from deepring.methods.network import NetworkMethod
from deepring.search.hits import Index
from deepring.search.search_settings import SearchSettings
from deepring.search.vector_index import VectorIndex


class VectorNetwork(NetworkMethod):
    """Base of networks with descriptors (b, value), of which the nearest is the most alike."""

    def compare(
        self, queries: Float[Tensor, "q value"], database: Float[Tensor, "d value"]
    ) -> Comparison:
        """Negative Euclidean distance, at most 0; the turn is not known."""
        return Comparison(negative_distance(queries, database), None)

    def index(self, settings: SearchSettings | None = None) -> Index:  # noqa: ARG002
        """Exhaustive search by distance, see `index_of`; takes no settings."""
        return VectorIndex("l2")
