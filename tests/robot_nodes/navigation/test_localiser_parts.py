"""The parts of the localiser in isolation, compared with the values of nav2_amcl."""

import math
from typing import Any

import numpy as np
import pytest

from btcore_navigation.distance_field import SignedDistanceField
from btcore_navigation.global_search import HEADINGS, GlobalSearch, SearchSpace
from btcore_navigation.likelihood import LikelihoodField, beam_endpoints, obstacle_distances
from btcore_navigation.parameters import AmclParameters
from btcore_navigation.particles import (
    best_cluster,
    decompose_motion,
    kld_sample_size,
    resample,
    sample_motion_model,
    sample_particles,
)
from btcore_navigation.pose_validation import changed_beam_shares
from btcore_navigation.ray_casting import RayCaster
from btcore_robot.occupancy_map import OccupancyMap
from btcore_robot.robot import LaserScan, Pose2D

ALPHAS = (0.2, 0.2, 0.2, 0.2)
EYE = (0.0, 0.0)


def empty(metres: float = 10.0, resolution: float = 0.05):
    """Return a map of free floor whose origin is (0, 0)."""
    cells = round(metres / resolution)
    return np.zeros((cells, cells), dtype=np.int8)


def walled(cells: np.ndarray):
    """Return a map with a wall of three cells at its edges."""
    cells[:3], cells[-3:], cells[:, :3], cells[:, -3:] = 100, 100, 100, 100
    return cells


def l_shaped():
    """Return a room of 10 m with a block in the north-east, so that every place looks different."""
    cells = walled(empty())
    cells[120:, 130:] = 100
    cells[40:46, 60:90] = 100
    return OccupancyMap(cells, 0.05, (0.0, 0.0))


def seen_from(field_map: Any, pose: Pose2D, count: int = 120, reach: float = 20.0):
    """Return the ends of beams in all directions, in the frame of a robot at *pose*, by steps of 5 mm."""
    angles = np.linspace(-math.pi, math.pi, count, endpoint=False)
    steps = np.arange(0.0, reach, 0.005)
    x = pose.x + np.cos(pose.yaw + angles)[:, None] * steps
    y = pose.y + np.sin(pose.yaw + angles)[:, None] * steps
    rows, columns = (y / 0.05).astype(int), (x / 0.05).astype(int)
    size = len(field_map.cells)
    solid = field_map.occupied[rows.clip(0, size - 1), columns.clip(0, size - 1)]
    lengths = steps[solid.argmax(axis=1)]
    return np.stack((np.cos(angles), np.sin(angles)), axis=1) * lengths[:, None]


def scan(ranges: np.ndarray, increment: float = 0.01, range_max: float = 25.0) -> LaserScan:
    return LaserScan(
        np.array(ranges, dtype=np.float32), 0, 0.0, increment, 0.05, range_max, "base_laser_link"
    )


# The likelihood field


@pytest.mark.parametrize(
    ("z", "pz"),
    [
        (0.0, 0.5 + 0.5 / 25.0),
        (0.2, 0.5 * math.exp(-0.5) + 0.5 / 25.0),
        (1.0, 0.5 * math.exp(-12.5) + 0.5 / 25.0),
        (3.0, 0.5 * math.exp(-50.0) + 0.5 / 25.0),  # farther than 2 m is 2 m
    ],
)
def test_a_weight_is_1_plus_the_cubes_of_its_beams_probabilities(z: float, pz: float) -> None:
    cells = empty()
    cells[100, 100] = 100
    field = LikelihoodField(OccupancyMap(cells, 0.05, (0.0, 0.0)), AmclParameters(), 25.0)
    middle = 100.5 * 0.05
    ends = np.array([[1.0 + z, 0.0], [1.0 + z, 0.0]])
    weight = field.weights(np.array([[middle - 1.0, middle, 0.0]]), ends)
    assert weight.shape == (1,)
    assert weight[0] == pytest.approx(1.0 + 2.0 * pz**3, rel=1e-5)


def test_a_beam_that_ends_outside_the_map_has_the_maximum_distance() -> None:
    cells = empty()
    cells[:, -1] = 100
    field = LikelihoodField(OccupancyMap(cells, 0.05, (0.0, 0.0)), AmclParameters(), 25.0)
    weight = field.weights(np.array([[9.0, 5.0, 0.0]]), np.array([[1.1, 0.0]]))
    far = 0.5 * math.exp(-(2.0**2) / (2 * 0.2**2)) + 0.5 / 25.0
    assert weight[0] == pytest.approx(1.0 + far**3, rel=1e-5)


def test_beams_are_transformed_by_the_pose_of_each_particle() -> None:
    field_map = l_shaped()
    field = LikelihoodField(field_map, AmclParameters(), 25.0)
    random = np.random.default_rng(3)
    particles = np.column_stack(
        (random.uniform(1, 9, 50), random.uniform(1, 9, 50), random.uniform(-3, 3, 50))
    )
    ends = random.uniform(-3, 3, (40, 2))
    z = obstacle_distances(field_map, 2.0)
    for particle, weight in zip(particles, field.weights(particles, ends), strict=True):
        x, y, yaw = particle
        world_x = x + math.cos(yaw) * ends[:, 0] - math.sin(yaw) * ends[:, 1]
        world_y = y + math.sin(yaw) * ends[:, 0] + math.cos(yaw) * ends[:, 1]
        rows, columns = np.floor(world_y / 0.05).astype(int), np.floor(world_x / 0.05).astype(int)
        inside = (rows >= 0) & (columns >= 0) & (rows < 200) & (columns < 200)
        far = np.where(inside, z[rows.clip(0, 199), columns.clip(0, 199)], 2.0)
        pz = 0.5 * np.exp(-(far**2) / 0.08) + 0.02
        assert weight == pytest.approx(1.0 + (pz**3).sum(), rel=1e-3)


def test_beams_are_an_even_sample_of_the_readings_with_an_echo() -> None:
    ranges = np.full(666, 2.0)
    ranges[11], ranges[22], ranges[33], ranges[44], ranges[55] = np.inf, -np.inf, np.nan, 0.04, 25.0
    ends = beam_endpoints(scan(ranges), 60, 0.05, 25.0)
    assert len(ends) == 61 - 5  # (666 - 1) // (60 - 1) = 11
    assert np.allclose(np.hypot(*ends.T), 2.0)
    assert np.allclose(np.arctan2(ends[1, 1], ends[1, 0]), 0.66)


# Motion


def test_a_motion_is_decomposed_into_a_turn_a_line_and_a_turn() -> None:
    turn, way, after = decompose_motion(Pose2D(1.0, 1.0, 0.5), Pose2D(1.0, 3.0, 0.0))
    assert (turn, way, after) == pytest.approx((math.pi / 2 - 0.5, 2.0, -math.pi / 2))
    assert decompose_motion(Pose2D(0, 0, 0), Pose2D(0.005, 0.005, 0.3))[0] == 0.0


@pytest.mark.parametrize("heading", [0.0, math.pi])
def test_the_noise_of_a_straight_motion_follows_the_model_in_both_directions(heading: float) -> None:
    before, after = Pose2D(0.0, 0.0, heading), Pose2D(0.5, 0.0, heading)
    start = np.zeros((200_000, 3))
    start[:, 2] = heading
    end = sample_motion_model(start, before, after, ALPHAS, np.random.default_rng(1))
    turn_noise, way_noise = math.sqrt(0.2 * 0.5**2), math.sqrt(0.2 * 0.5**2)
    assert np.std(np.hypot(end[:, 0], end[:, 1])) == pytest.approx(way_noise, rel=0.1)
    bearing = np.arctan2(end[:, 1], end[:, 0])[end[:, 0] > 0]
    assert np.std(bearing) == pytest.approx(turn_noise, rel=0.02)
    off = np.remainder(end[:, 2] - heading + math.pi, 2 * math.pi) - math.pi
    assert np.std(off) == pytest.approx(math.hypot(turn_noise, turn_noise), rel=0.02)
    assert np.mean(off) == pytest.approx(0.0, abs=0.01)


def test_the_noise_of_a_turn_on_the_spot_follows_the_model() -> None:
    end = sample_motion_model(
        np.zeros((200_000, 3)), Pose2D(0, 0, 0), Pose2D(0, 0, 0.4), ALPHAS, np.random.default_rng(1)
    )
    assert np.mean(end[:, 2]) == pytest.approx(0.4, abs=0.01)
    assert np.std(end[:, 2]) == pytest.approx(math.sqrt(0.2 * 0.4**2), rel=0.02)
    assert np.std(end[:, 0]) == pytest.approx(math.sqrt(0.2 * 0.4**2), rel=0.1)


# Particles


@pytest.mark.parametrize(("bins", "size"), [(0, 2000), (1, 2000), (2, 500), (100, 1129), (1000, 2000)])
def test_the_number_of_particles_depends_on_the_number_of_occupied_bins(bins: int, size: int) -> None:
    assert kld_sample_size(bins, 0.05, 0.99, 500, 2000) == size


def test_kld_sampling_follows_foxs_formula_between_its_bounds() -> None:
    k, err, z = 60, 0.05, 0.99
    spread = 2 / (9 * (k - 1))
    expected = (k - 1) / (2 * err) * (1 - spread + math.sqrt(spread) * z) ** 3
    assert kld_sample_size(k, err, z, 1, 10_000) == math.ceil(expected)


def test_a_tight_cloud_needs_few_particles_and_a_wide_cloud_many() -> None:
    random = np.random.default_rng(0)
    even = np.full(2000, 1 / 2000)
    figures = {"err": 0.05, "z": 0.99, "least": 500, "most": 2000}
    tight = sample_particles(Pose2D(1, 1, 0), np.diag([0.1, 0.1, 0.05]) ** 2, 2000, random)
    wide = sample_particles(Pose2D(1, 1, 0), np.diag([3.0, 3.0, 1.0]) ** 2, 2000, random)
    assert len(resample(tight, even, random, **figures)) == 500
    assert len(resample(wide, even, random, **figures)) == 2000


def test_resampling_is_proportional_to_weight() -> None:
    particles = np.array([[0.0, 0.0, 0.0], [9.0, 0.0, 0.0]])
    chosen = resample(
        particles, np.array([0.25, 0.75]), np.random.default_rng(5), err=0.05, z=0.99, least=400, most=400
    )
    assert abs(int((chosen[:, 0] == 9.0).sum()) - 300) <= 1


def test_the_pose_is_the_mean_of_the_heaviest_cluster_also_across_half_a_turn() -> None:
    random = np.random.default_rng(2)
    spread = np.diag([0.1, 0.2, 0.1]) ** 2
    heavy = sample_particles(Pose2D(2.0, 3.0, math.pi), spread, 600, random)
    light = sample_particles(Pose2D(7.0, 3.0, 0.0), spread, 400, random)
    best = best_cluster(np.concatenate((heavy, light)), np.full(1000, 0.001))
    assert (best.pose.x, best.pose.y) == pytest.approx((2.0, 3.0), abs=0.03)
    assert abs(math.remainder(best.pose.yaw - math.pi, 2 * math.pi)) < 0.02
    assert best.weight == pytest.approx(0.6, abs=0.01)
    assert np.sqrt(np.diag(best.covariance)) == pytest.approx([0.1, 0.2, 0.1], rel=0.15)


# Matching and agreement


@pytest.mark.parametrize("off", [(0.15, -0.1, 0.06), (-0.12, 0.12, -0.08), (0.0, 0.0, 0.0)])
def test_a_match_refines_a_guess_to_centimetres(off: tuple[float, float, float]) -> None:
    field_map, true = l_shaped(), Pose2D(3.0, 5.0, 0.7)
    points = seen_from(field_map, true)
    guess = Pose2D(true.x + off[0], true.y + off[1], true.yaw + off[2])
    found = SignedDistanceField(field_map).match(guess, points, EYE, deviation=(0.2, 0.1))
    assert math.hypot(found.pose.x - true.x, found.pose.y - true.y) < 0.02
    assert abs(found.pose.yaw - true.yaw) < 0.01
    assert found.share == 1.0


def test_people_in_the_way_do_not_distort_a_match() -> None:
    field_map, true = l_shaped(), Pose2D(3.0, 5.0, 0.7)
    points = seen_from(field_map, true)
    points[40:60] *= 0.5
    guess = Pose2D(true.x + 0.05, true.y - 0.05, true.yaw + 0.02)
    found = SignedDistanceField(field_map).match(guess, points, EYE, deviation=(0.05, 0.05))
    assert math.hypot(found.pose.x - true.x, found.pose.y - true.y) < 0.02


def test_a_match_does_not_move_a_guess_along_a_bare_corridor() -> None:
    cells = empty()
    cells[80:83], cells[120:123] = 100, 100
    field_map = OccupancyMap(cells, 0.05, (0.0, 0.0))
    points = seen_from(field_map, Pose2D(5.0, 5.0, 0.0), reach=4.0)
    points = points[np.abs(points[:, 1]) > 0.5]
    found = SignedDistanceField(field_map).match(Pose2D(5.3, 5.08, 0.0), points, EYE, deviation=(0.1, 0.1))
    assert found.pose.x == pytest.approx(5.3, abs=0.02)
    assert found.pose.y == pytest.approx(5.0, abs=0.01)


def test_a_laser_beside_the_robot_determines_the_side_of_a_wall_that_is_seen() -> None:
    cells = empty()
    cells[97:103] = 100
    walls = SignedDistanceField(OccupancyMap(cells, 0.05, (0.0, 0.0)))
    along = np.linspace(-1.0, 1.0, 21)
    # The robot is below the wall, and its laser, 1 m to the left, sees the upper side.
    points = np.stack((along, np.full(21, 0.65)), axis=1)
    found = walls.match(Pose2D(5.0, 4.4, 0.0), points, (0.0, 1.0), deviation=(0.2, 0.01))
    assert found.pose.y == pytest.approx(4.5, abs=0.01)


def test_people_shorten_beams_and_at_a_wrong_pose_beams_pass_through_walls() -> None:
    field_map, true = l_shaped(), Pose2D(3.0, 5.0, 0.7)
    visibility = RayCaster(field_map, 25.0)
    points = seen_from(field_map, true)
    right, wrong = visibility.agreement([true, Pose2D(5.5, 8.0, -2.0)], EYE, points)
    assert (right.hit_share, right.through_share) == (1.0, 0.0)
    assert wrong.hit_share < 0.5
    assert wrong.through_share > 0.2
    points[:60] *= 0.5
    crowded = visibility.agreement([true], EYE, points)[0]
    assert crowded.hit_share == pytest.approx(0.5, abs=0.05)
    assert crowded.through_share == 0.0
    assert np.array_equal(visibility.unobstructed_beams(true, EYE, points), np.arange(120) >= 60)


def test_a_scan_that_turns_with_the_robot_has_not_changed() -> None:
    angles = np.arange(666) * 0.0058
    before = scan(3.0 + np.sin(angles), 0.0058)
    turned = scan(3.0 + np.sin(angles + 0.3), 0.0058)
    assert changed_beam_shares(before, turned, 0.3) == (0.0, 0.0)
    farther, nearer = changed_beam_shares(before, scan(np.full(666, 9.0), 0.0058), 0.0)
    assert (farther, nearer) == (1.0, 0.0)


@pytest.mark.parametrize("true", [Pose2D(3.0, 5.0, 0.7), Pose2D(8.0, 2.0, -2.5), Pose2D(2.0, 8.5, 3.0)])
def test_the_whole_map_is_searched_in_slices(true: Pose2D) -> None:
    field_map = l_shaped()
    search = GlobalSearch(SearchSpace(field_map), seen_from(field_map, true, count=60))
    slices = 1
    while not search.advance(25):
        slices += 1
    assert slices == math.ceil(HEADINGS / 25)
    best, *others = search.candidates(10)
    assert math.hypot(best.pose.x - true.x, best.pose.y - true.y) < 0.15
    assert abs(math.remainder(best.pose.yaw - true.yaw, 2 * math.pi)) < 0.06
    assert all(other.score <= best.score for other in others)
