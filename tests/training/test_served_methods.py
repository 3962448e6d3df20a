"""Which methods a scheme serves: the others are refused before any scan is read, by name."""

import pytest

from deepring.errors import ConfigError
from deepring.methods.network import NetworkMethod
from deepring.methods.registry import class_at, packaged_methods
from deepring.training.batch_hard import BatchHardScheme, BatchHardTriplet
from deepring.training.batch_softmax import BatchSoftmaxWithTurn
from deepring.training.correspondences import CorrespondenceScheme, NTuple
from deepring.training.module import PlaceModule
from deepring.training.pairs import (
    Contrastive,
    OverlapAndTurn,
    OverlapScheme,
    PairScheme,
    SoftMatch,
)
from deepring.training.poses import PoseScheme, TripletWithPose
from deepring.training.segments import SegmentIdentity, SegmentScheme
from deepring.training.tuples import LazyQuadruplet, QuadrupletWithTurn, TupleScheme
from helpers.cli import deepring
from helpers.small_training import TINY_DATA
from helpers.tiny_methods import TINY

#: Schemes with a loss, and the methods that each serves.
SERVED = {
    CorrespondenceScheme(points=32): (NTuple(), ("dh3d",)),
    OverlapScheme(): (OverlapAndTurn(), ("overlapnet",)),
    PoseScheme(): (TripletWithPose(), ("lcdnet",)),
    SegmentScheme(): (SegmentIdentity(8192, feature=8, cells=(4, 4, 4)), ("locus",)),
    PairScheme(): (SoftMatch(), ("rinet",)),
}


@pytest.fixture(scope="module")
def networks():
    """Every learned method by name."""
    return {
        name: make()
        for name, make in TINY.items()
        if issubclass(class_at(packaged_methods()[name]), NetworkMethod)
    }


@pytest.mark.parametrize("scheme", SERVED, ids=lambda scheme: type(scheme).__name__)
def test_a_scheme_names_the_methods_that_it_does_not_serve(scheme, networks):
    loss, served = SERVED[scheme]
    for name, network in networks.items():
        if name in served:
            PlaceModule(network, scheme, loss)
            continue
        with pytest.raises(ConfigError) as caught:
            PlaceModule(network, scheme, loss)
        by = (
            "loss: SoftMatch"
            if isinstance(loss, SoftMatch)
            else f"sampling: {type(scheme).__name__}"
        )
        assert str(caught.value).startswith(
            f"{by} does not serve {network.settings.label}, expected"
        )


@pytest.mark.parametrize(
    ("scheme", "loss"),
    [
        (BatchHardScheme(), BatchHardTriplet()),
        (TupleScheme(turned=True), LazyQuadruplet()),
        (PairScheme(turned=True), Contrastive()),
    ],
)
def test_scans_that_cannot_be_turned_are_refused_where_they_are_to_be(scheme, loss, networks):
    with pytest.raises(ConfigError, match="a BevRaster cannot be turned"):
        PlaceModule(networks["deepring"], scheme, loss)
    PlaceModule(networks["disco"], scheme, loss)


@pytest.mark.parametrize(
    ("scheme", "loss"),
    [(TupleScheme, QuadrupletWithTurn()), (BatchHardScheme, BatchSoftmaxWithTurn())],
)
def test_a_loss_of_turns_wants_maps_and_turned_scans(scheme, loss, networks):
    PlaceModule(networks["disco"], scheme(turned=True), loss)
    with pytest.raises(ConfigError, match=r"sampling\.turned: false, expected true"):
        PlaceModule(networks["disco"], scheme(turned=False), loss)
    with pytest.raises(ConfigError, match=r"not PointNetVLAD with \(\d+,\); choose a loss"):
        PlaceModule(networks["pointnetvlad"], scheme(turned=True), loss)


def test_no_scan_is_read_for_a_method_that_is_not_served(tiny_nclt, tmp_path):
    pair = ("method=deepring_small", "sampling=poses", "loss=triplet_with_pose")
    done = deepring("train", *pair, *TINY_DATA, f"data.root={tiny_nclt}", cwd=tmp_path)
    assert done.returncode == 2
    line = done.stderr.splitlines()[-1]
    assert line.startswith("error: sampling: PoseScheme does not serve DeepRING, expected")
    assert not (tmp_path / "outputs" / "cache").exists()
