"""Obstacles that turn out to move leave no trace in the maps; static obstacles stay."""

import numpy as np
import pytest

from mapping.grid.dynamic_traces import DynamicTraces
from mapping.grid.egocentric_grid import EgocentricGrid, GridConfig
from mapping.grid.world_map import WorldMap
from perception.floor.segmented_view import MARGIN_M
from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle

RADIUS_M = 0.10
CAMERA = np.array([-2.0, 0.0, 1.2])


def raised(xy: np.ndarray) -> np.ndarray:
    return np.column_stack([xy, np.full(len(xy), 0.3)])


def track(number: int, x: float, moving: float, seen_s: float) -> Obstacle:
    state = Gaussian(np.array([x, 0.0, 0.0, 0.0]), 1e-4 * np.eye(4))
    return Obstacle(state, RADIUS_M, track=number, moving=moving, seen_s=seen_s)


def test_discs_of_a_track_are_returned_once_when_it_starts_to_move() -> None:
    traces = DynamicTraces()
    for stamp, x in zip((0.0, 1.0, 2.0), (1.0, 1.01, 1.08), strict=True):
        discs, _ = traces.update([track(4, x, 0.2, stamp), track(5, 3.0, 0.1, stamp)], stamp)
        assert not len(discs)
    discs, radii = traces.update([track(4, 1.2, 0.95, 3.0), track(5, 3.0, 0.1, 3.0)], 3.0)
    np.testing.assert_allclose(discs[:, 0], [1.0, 1.08])
    np.testing.assert_allclose(radii, RADIUS_M + MARGIN_M)
    discs, _ = traces.update([track(4, 1.3, 0.95, 4.0), track(5, 3.0, 0.1, 4.0)], 4.0)
    assert not len(discs)


def test_predicted_positions_are_no_traces() -> None:
    """Between detections the position of a track is a prediction, and no cell was marked there."""
    traces = DynamicTraces()
    traces.update([track(4, 1.0, 0.2, 0.0)], 0.0)
    traces.update([track(4, 2.0, 0.2, 0.0)], 5.0)
    discs, _ = traces.update([track(4, 2.5, 0.95, 6.0)], 6.0)
    np.testing.assert_allclose(discs[:, 0], [1.0])


@pytest.mark.parametrize("kind", ["grid", "world"])
def test_the_maps_clear_a_dynamic_trace_and_keep_the_wall_beside_it(kind: str) -> None:
    grid, world = EgocentricGrid(GridConfig(), np.zeros(2)), WorldMap()
    for stamp in (1.0, 2.0):
        for x in (1.0, 1.5):
            points = np.array([x, 0.0]) + 0.001 * np.arange(6)[:, None]
            grid.update(points, np.ones(6, bool), stamp, np.zeros(2))
            world.update(raised(points), np.ones(6, bool), stamp, CAMERA)
    one = grid if kind == "grid" else world
    one.mark_moving(np.array([[1.0, 0.0]]), np.array([RADIUS_M + MARGIN_M]))
    grid.update(np.array([[0.5, 0.5]]), np.zeros(1, bool), 3.0, np.zeros(2))
    world.update(np.array([[0.5, 0.5, 0.0]]), np.zeros(1, bool), 3.0, CAMERA)
    one.age(60.0)
    here, beside = (tuple(one.cell_of(np.array([x, 0.001]))) for x in (1.001, 1.501))
    assert not one.known[here]
    assert one.probability[beside] > 0.85


def test_discs_beyond_the_edge_of_the_world_map_change_nothing() -> None:
    world = WorldMap()
    world.mark_moving(np.array([[9.0, 9.0]]), np.array([0.2]))
    world.update(raised(np.zeros((3, 2))), np.ones(3, bool), 1.0, CAMERA)
    world.mark_moving(np.array([[0.0, 0.0], [-50.0, 40.0]]), np.array([0.3, 0.3]))
    assert world.probability[tuple(world.cell_of(np.zeros(2)))] < 0.8


def test_only_cells_with_their_centre_in_the_disc_fade() -> None:
    """Wherever the map begins: a far point has made it grow."""
    rng = np.random.default_rng(2)
    centre, radius = np.array([0.13, -0.31]), 0.17
    points = np.repeat(rng.uniform(-0.6, 0.6, (800, 2)), 3, axis=0)
    world = WorldMap()
    everything = raised(np.concatenate([points, [[-3.0, 2.0]]]))
    world.update(everything, np.ones(2401, bool), 1.0, CAMERA)
    world.mark_moving(centre[None], np.array([radius]))
    rows, columns = np.indices(world.probability.shape)
    middles = world.origin + world.cell_m * (np.stack([columns, rows], axis=-1) + 0.5)
    inside = np.hypot(*np.moveaxis(middles - centre, -1, 0)) <= radius
    occupied = world.known & (world.probability > 0.5)
    faded = world.probability < 0.8
    np.testing.assert_array_equal(faded[occupied], inside[occupied])
    assert (inside & occupied).sum() > 20
