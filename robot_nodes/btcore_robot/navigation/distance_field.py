"""Matching a scan to the map: the pose near a guess at which the beams end on the faces of what is mapped."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from btcore_robot.navigation.likelihood import distances
from btcore_robot.navigation.occupancy_map import OccupancyMap
from btcore_robot.rigid_transform import wrap_angle
from btcore_robot.robot import Pose2D

Floats = NDArray[np.float64]

FAR = 1.0
"""How far (m) off a face the pull towards it ends; what lies farther off is not on the map."""
ON_A_FACE = 0.2
"""A beam that ends nearer (m) than this to a face fits it: three times the noise of Tiago's laser."""
BEAM_DEVIATION = 0.1
"""How sure (m) a single beam is in a match: the laser's noise, and that the map is drawn in cells."""
_ENOUGH = 1e-4  # a step shorter than this (m, rad) is the last


@dataclass(frozen=True, slots=True)
class Match:
    """The *pose* that was found, and the *share* (0 … 1) of the beams that end on a face there."""

    pose: Pose2D
    share: float


class SignedDistanceField:
    """The signed distance (m) to the nearest face between occupied and other cells, below 0 inside of things.

    Unlike the likelihood field it doesn't draw a pose forward, into the wall by the noise of the laser.
    Each cell has the distance at its middle and the gradient there, which carry over the cell.
    """

    def __init__(self, field_map: OccupancyMap) -> None:
        half = field_map.resolution / 2.0
        outside = distances(field_map, FAR)
        solid = OccupancyMap(
            np.where(field_map.occupied, 0, 100).astype(np.int8), field_map.resolution, field_map.origin
        )
        inside = distances(solid, FAR)
        signed = np.where(field_map.occupied, half - inside, outside - half).astype(np.float64)
        signed = np.pad(signed, 1, constant_values=FAR)
        along_y, along_x = np.gradient(signed, field_map.resolution)
        self._table = np.stack((signed, along_x, along_y), axis=-1).astype(np.float32).reshape(-1, 3)
        self._shape = signed.shape
        self._resolution = field_map.resolution
        self._origin = (
            field_map.origin[0] - field_map.resolution,
            field_map.origin[1] - field_map.resolution,
        )

    def at(self, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
        """The signed distance (m) at points of the map, and its gradient along x and y."""
        u = (x - self._origin[0]) / self._resolution
        v = (y - self._origin[1]) / self._resolution
        column = np.clip(u, 0.0, self._shape[1] - 1).astype(np.intp)
        row = np.clip(v, 0.0, self._shape[0] - 1).astype(np.intp)
        found = self._table[row * self._shape[1] + column].T.astype(np.float64)
        distance, along_x, along_y = found
        off_x = np.clip(u - column - 0.5, -0.5, 0.5) * self._resolution
        off_y = np.clip(v - row - 0.5, -0.5, 0.5) * self._resolution
        return distance + along_x * off_x + along_y * off_y, along_x, along_y

    def match(
        self,
        guess: Pose2D,
        points: Floats,
        eye: tuple[float, float],
        *,
        trust: tuple[float, float],
        scales: tuple[float, ...] = (0.5, 0.4, 0.3, 0.2, 0.15, 0.1, 0.1, 0.1),
    ) -> Match:
        """The pose near *guess* where *points*, beams' ends in the robot's frame (m; ``(k, 2)``), meet faces.

        Gauss-Newton steps, in which a beam weighs less the farther it ends from a face (Geman and McClure),
        with one of *scales* (m) each. Faces turned away from *eye*, where the laser is, are none that it can
        see. *trust* is the deviation (m, rad) of the guess: what the beams don't tell, as the place along a
        corridor, stays.
        """
        x, y, yaw = guess.x, guess.y, guess.yaw
        prior = np.array((1.0 / trust[0] ** 2, 1.0 / trust[0] ** 2, 1.0 / trust[1] ** 2)) * BEAM_DEVIATION**2
        start = np.array((x, y, yaw))
        for scale in scales:
            cos, sin = math.cos(yaw), math.sin(yaw)
            ahead = cos * points[:, 0] - sin * points[:, 1]
            aside = sin * points[:, 0] + cos * points[:, 1]
            distance, along_x, along_y = self.at(x + ahead, y + aside)
            eye_x, eye_y = cos * eye[0] - sin * eye[1], sin * eye[0] + cos * eye[1]
            seen = along_x * (ahead - eye_x) + along_y * (aside - eye_y) <= 0.0
            slopes = np.stack((along_x, along_y, along_y * ahead - along_x * aside))
            weight = seen * (scale**2 / (scale**2 + distance**2)) ** 2
            weighted = slopes * weight
            normal = weighted @ slopes.T
            normal[np.arange(3), np.arange(3)] += prior + 1e-9
            step = np.linalg.solve(normal, weighted @ distance + prior * (np.array((x, y, yaw)) - start))
            x, y, yaw = x - float(step[0]), y - float(step[1]), yaw - float(step[2])
            if np.abs(step).max() < _ENOUGH:
                break
        return Match(Pose2D(x, y, wrap_angle(yaw)), self.fit(Pose2D(x, y, yaw), points))

    def fit(self, pose: Pose2D, points: Floats) -> float:
        """The share (0 … 1) of *points* that end within `ON_A_FACE` of a face when the robot is at *pose*."""
        cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
        distance = np.abs(
            self.at(
                pose.x + cos * points[:, 0] - sin * points[:, 1],
                pose.y + sin * points[:, 0] + cos * points[:, 1],
            )[0]
        )
        return float(np.mean(distance <= ON_A_FACE)) if len(points) else 0.0
