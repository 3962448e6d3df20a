"""The frame of one map in another: exact without noise, untouched by wrong locations."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deepring.errors import DataError
from deepring.localization.common_frame import APART, LEAST, PlanarFrame, common_frame

ANGLE = st.floats(-math.pi, math.pi)
METRES = st.floats(-1e4, 1e4)


def drive(count, seed=0, size=300.0):
    rng = np.random.default_rng(seed)
    return np.column_stack(
        [rng.uniform(-size, size, (count, 2)), rng.uniform(-math.pi, math.pi, count)]
    )


def off(frame, true):
    yaw = (frame.yaw - true.yaw + math.pi) % (2 * math.pi) - math.pi
    return math.hypot(frame.x - true.x, frame.y - true.y), abs(yaw)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(METRES, METRES, ANGLE, st.integers(0, 9))
def test_exact_locations_give_the_frame_exactly(x, y, yaw, seed):
    true, poses = PlanarFrame(x, y, yaw), drive(LEAST, seed)
    frame, agree = common_frame(poses, true.applied(poses))
    assert agree.all()
    assert max(off(frame, true)) < 1e-6


@settings(max_examples=60, deadline=None, derandomize=True)
@given(ANGLE, st.integers(0, 10**6), st.integers(0, 14))
def test_wrong_locations_do_not_move_it(yaw, seed, wrong):
    rng = np.random.default_rng(seed)
    true, poses = PlanarFrame(70.0, -20.0, yaw), drive(30, seed)
    located = true.applied(poses) + rng.normal(scale=[0.4, 0.4, 0.008], size=(30, 3))
    clean, _ = common_frame(poses[wrong:], located[wrong:])
    located[:wrong] = drive(wrong, seed + 1)
    frame, agree = common_frame(poses, located)
    assert not agree[:wrong].any() or wrong == 0
    assert agree[wrong:].mean() > 0.9
    away, turned = off(frame, clean)
    assert away < 0.5
    assert turned < math.radians(0.3)
    assert off(frame, true)[0] < 1.0


def test_a_turn_of_the_other_sense_is_another_frame():
    """The usual misreading: points turned by +yaw are of a frame turned by -yaw."""
    poses, true = drive(20), PlanarFrame(3.0, 4.0, 0.5)
    frame, _ = common_frame(poses, true.applied(poses))
    backwards = PlanarFrame(3.0, 4.0, -frame.yaw).applied(poses)
    assert np.linalg.norm(backwards - true.applied(poses), axis=1).min() > 10
    back, _ = common_frame(true.applied(poses), poses)
    np.testing.assert_allclose(back.applied(true.applied(poses))[:, :2], poses[:, :2], atol=1e-6)


@pytest.mark.parametrize(
    ("poses", "located", "words"),
    [
        (drive(LEAST - 1), drive(LEAST - 1), "4 places are located, expected at least 5"),
        (drive(0), drive(0), "0 places are located"),
        (drive(30), drive(30, 1), "of 30 located places agree .* expected at least 15"),
        (drive(30, size=APART / 3), drive(30, size=APART / 3), "lie within 1[0-9] m"),
    ],
)
def test_too_few_or_too_near_places_are_refused(poses, located, words):
    with pytest.raises(DataError, match=words):
        common_frame(poses, located)


def test_half_of_the_places_may_not_decide_against_the_other_half():
    poses = drive(40)
    located = np.concatenate(
        [PlanarFrame(0, 0, 0).applied(poses[:19]), PlanarFrame(50, 0, 0).applied(poses[19:38]),
         drive(2, 5)]
    )  # fmt: skip
    with pytest.raises(DataError, match="19 of 40"):
        common_frame(poses, located)
