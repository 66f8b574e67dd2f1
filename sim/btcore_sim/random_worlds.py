"""Random offices and homes with furniture, as objects of world files.

An office has rooms on both sides of a corridor. A home is a rectangle that is divided into rooms. Doors are
0.8 to 1.2 m wide. Each room has furniture of its kind and a waypoint, and a robot has room on the way to all
other waypoints. The kind, the number of rooms and the seed determine the world.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from btcore_sim import furniture
from btcore_sim.clearance_map import ClearanceMap, Point
from btcore_sim.errors import SimError
from btcore_sim.furniture import Draw, Furniture, Part
from btcore_sim.random_world_kinds import ROOMS
from btcore_sim.world import random_generator
from btcore_sim.world_description import Rectangle, WorldDescription, WorldObject, parse_world_description

DOOR_WIDTHS = (0.8, 0.85, 0.9, 1.0, 1.1, 1.2)
"""Widths of doors (m)."""

MIN_WAY_CLEARANCE = 0.375
"""Clearance (m) on the ways between all doors and waypoints: 10 cm more than the radius of the Tiago."""

MIN_WAYPOINT_CLEARANCE = 0.55
"""Clearance (m) at a waypoint."""

_WALL_THICKNESS = 0.2  # m: thickness of the walls
_WALL_HEIGHT = 2.5  # m: height of the walls
_WALL_COLOR = "#d9d4c7"
_MIN_WALL_BESIDE_DOOR = 0.2  # m of wall at least between the frame of a door and the next corner
_FREE_DEPTH_AT_DOOR = 0.9  # m in front of a door on both sides that stay free
_FURNITURE_GAP = 0.03  # m between furniture and walls, or between two pieces
_MAX_PLACEMENT_ATTEMPTS = 30  # attempts to place a piece of furniture
_MAX_WORLD_ATTEMPTS = 50  # attempts to make a world
_MIN_ROOM_SIDE = 2.4  # m: the smallest side of a room
_MIN_WAYPOINT_DISTANCE = 1.2  # m between waypoints in the same room, if possible
_GRID_STEP = 0.05  # m: walls are at multiples of it, so that they fill the cells of a map

_FURNITURE: dict[str, tuple[tuple[Draw, int, int], ...]] = {
    "office": (
        (furniture.desk, 2, 4),
        (furniture.shelf, 1, 2),
        (furniture.cabinet, 0, 2),
        (furniture.plant, 0, 2),
    ),
    "meeting room": ((furniture.meeting_table, 1, 1), (furniture.cabinet, 0, 1), (furniture.plant, 1, 2)),
    "lounge": (
        (furniture.kitchen_unit, 1, 1),
        (furniture.dining_table, 0, 1),
        (furniture.sofa, 1, 1),
        (furniture.plant, 0, 2),
    ),
    "store room": ((furniture.rack, 3, 5), (furniture.printer, 0, 1)),
    "corridor": ((furniture.printer, 0, 1), (furniture.plant, 0, 3), (furniture.cabinet, 0, 1)),
    "living room": (
        (furniture.sofa, 1, 2),
        (furniture.coffee_table, 1, 1),
        (furniture.sideboard, 1, 1),
        (furniture.armchair, 0, 2),
        (furniture.shelf, 0, 1),
        (furniture.plant, 0, 2),
    ),
    "kitchen": ((furniture.kitchen_unit, 1, 1), (furniture.dining_table, 1, 1), (furniture.plant, 0, 1)),
    "bedroom": (
        (furniture.bed, 1, 1),
        (furniture.wardrobe, 1, 1),
        (furniture.drawers, 0, 1),
    ),
    "bathroom": ((furniture.bathtub, 0, 1), (furniture.toilet, 1, 1), (furniture.basin, 1, 1)),
    "study": (
        (furniture.desk, 1, 1),
        (furniture.shelf, 1, 2),
        (furniture.armchair, 0, 1),
        (furniture.plant, 0, 1),
    ),
}
"""The furniture of each kind of room: what is drawn, and the smallest and the greatest number."""


@dataclass(frozen=True, slots=True)
class Room:
    """A room: its *kind*, and its *area* (m) between the middles of its walls."""

    kind: str
    area: Rectangle

    @property
    def inside(self) -> Rectangle:
        """The floor (m) between the walls."""
        x0, y0, x1, y1 = self.area
        half = _WALL_THICKNESS / 2
        return x0 + half, y0 + half, x1 - half, y1 - half


@dataclass(frozen=True, slots=True)
class Door:
    """A door: the *middle* of its opening (m), the *width* (m), and whether its wall is along the x axis."""

    middle: Point
    width: float
    along_x: bool

    def free_area(self) -> Rectangle:
        """Return the area (m) on both sides that stays free."""
        x, y = self.middle
        half, deep = self.width / 2 + 0.05, _FREE_DEPTH_AT_DOOR + _WALL_THICKNESS / 2
        dx, dy = (half, deep) if self.along_x else (deep, half)
        return x - dx, y - dy, x + dx, y + dy


class _WallSection(NamedTuple):
    """A straight part of a wall, in m.

    Attributes:
        begin: The smaller end, on the axis along which the wall runs.
        end: The greater end.
        offset: The place of the wall on the other axis.
        along_x: Whether the wall runs along the x axis.
    """

    begin: float
    end: float
    offset: float
    along_x: bool


@dataclass(slots=True)
class FloorPlan:
    """A floor plan. The first of the *rooms* is the one that most ways lead through."""

    rooms: list[Room]
    doors: list[Door]


class _UnusablePlanError(Exception):
    """A drawn plan has no place for what it needs. Another plan is drawn then."""


def random_world(kind: str, seed: int, rooms: int = ROOMS) -> WorldDescription:
    """Return a random world.

    Args:
        kind: `office` or `home`.
        seed: The seed. The same arguments give the same world.
        rooms: The number of rooms; the corridor of an office is not counted.

    Raises:
        SimError: No world was found; `office` and `home` with up to `MAX_ROOMS` rooms are found in practice.
    """
    return parse_world_description(random_world_json(kind, seed, rooms), f"{kind}_{seed}")


def random_world_json(kind: str, seed: int, rooms: int = ROOMS) -> dict[str, Any]:
    """Return the JSON object of a random world, in the form of world files.

    Args:
        kind: `office` or `home`.
        seed: The seed. The same arguments give the same world.
        rooms: The number of rooms; the corridor of an office is not counted.

    Raises:
        SimError: No world was found.
    """
    for attempt in range(_MAX_WORLD_ATTEMPTS):
        random = random_generator(seed, f"{kind} with {rooms} rooms, attempt {attempt}")
        try:
            plan = _draw_office(random, rooms) if kind == "office" else _draw_home(random, rooms)
            return _furnish_plan(plan, random, f"a random {kind} of {rooms} rooms, seed {seed}")
        except _UnusablePlanError:
            continue
    raise SimError(f"no {kind} of {rooms} rooms was found with seed {seed}: use another seed")


def _draw_office(random: np.random.Generator, count: int) -> FloorPlan:
    """Draw rooms along both sides of a corridor, each with a door to the corridor."""
    rooms_per_side = [math.ceil(count / 2), count // 2]
    length = _round_to_grid(max(rooms_per_side) * random.uniform(3.4, 4.6))
    corridor_width = _round_to_grid(random.uniform(1.7, 2.3))
    room_depths = [_round_to_grid(random.uniform(3.6, 5.2)) for _ in rooms_per_side]
    kinds = _draw_room_kinds(random, count, ("office", "meeting room", "lounge", "store room"), "office")
    rooms = [Room("corridor", (0.0, 0.0, length, corridor_width))]
    doors: list[Door] = []
    for side, number in enumerate(rooms_per_side):
        y0, y1, wall = (
            (corridor_width, _round_to_grid(corridor_width + room_depths[0]), corridor_width),
            (-room_depths[1], 0.0, 0.0),
        )[side]
        edges = _divide_length(random, 0.0, length, number, 2.8)
        for x0, x1 in itertools.pairwise(edges):
            rooms.append(Room(kinds.pop(), (x0, y0, x1, y1)))
            doors.append(_draw_door(random, _WallSection(x0, x1, wall, along_x=True)))
    if random.random() < 0.4:  # a door between two neighbours
        pairs = [(a, b) for a, b in itertools.pairwise(rooms[1:]) if a.area[2] == b.area[0]]
        if pairs:
            first, second = pairs[int(random.integers(len(pairs)))]
            low, high = max(first.area[1], second.area[1]), min(first.area[3], second.area[3])
            doors.append(_draw_door(random, _WallSection(low, high, first.area[2], along_x=False)))
    return FloorPlan(rooms, doors)


def _draw_home(random: np.random.Generator, count: int) -> FloorPlan:
    """Draw adjacent rooms, and doors that connect all of them."""
    floor_area = count * random.uniform(13.0, 17.0)
    side_ratio = random.uniform(1.0, 1.6)
    width = _round_to_grid(math.sqrt(floor_area * side_ratio))
    areas = _split_area(random, (0.0, 0.0, width, _round_to_grid(floor_area / width)), count)
    areas.sort(key=lambda area: -(area[2] - area[0]) * (area[3] - area[1]))
    kinds = [
        "living room",
        *_draw_room_kinds(random, count - 1, ("kitchen", "bathroom", "study"), "bedroom")[::-1],
    ]
    # The smallest room is the bathroom, if there is one.
    kinds.sort(key=lambda kind: kind == "bathroom")
    rooms = [Room(kind, area) for kind, area in zip(kinds, areas, strict=True)]
    shared_walls = [
        (a, b, wall)
        for a, b in itertools.combinations(range(count), 2)
        for wall in _find_shared_walls(rooms[a], rooms[b])
    ]
    # The rooms are sorted by size: the ways lead through the large rooms, and not through the bathroom.
    shared_walls.sort(key=lambda entry: entry[0] + entry[1])
    groups = list(range(count))  # the rooms of a group are connected by doors
    doors: list[Door] = []
    for a, b, wall in shared_walls:
        is_connected = groups[a] == groups[b]
        if not is_connected or ("bathroom" not in (kinds[a], kinds[b]) and random.random() < 0.15):
            doors.append(_draw_door(random, wall))
            groups = [groups[a] if group == groups[b] else group for group in groups]
    if len(set(groups)) > 1:
        raise _UnusablePlanError
    return FloorPlan(rooms, doors)


def _draw_room_kinds(
    random: np.random.Generator, count: int, single_kinds: Sequence[str], usual_kind: str
) -> list[str]:
    """Return *count* kinds of rooms in random order: the single kinds at most once, and the usual kind."""
    kinds = [*single_kinds[: max(0, count - 1)], *itertools.repeat(usual_kind, count)][:count]
    random.shuffle(kinds)
    return kinds


def _divide_length(
    random: np.random.Generator, begin: float, end: float, count: int, min_length: float
) -> list[float]:
    """Return the ends of *count* sections from *begin* to *end*, each at least *min_length* long (m)."""
    spare = end - begin - count * min_length
    if spare < 0.0:
        raise _UnusablePlanError
    lengths = random.dirichlet(np.full(count, 4.0)) * spare + min_length
    inner = [_round_to_grid(begin + float(distance)) for distance in np.cumsum(lengths)[:-1]]
    return [begin, *inner, end]


def _split_area(random: np.random.Generator, area: Rectangle, count: int) -> list[Rectangle]:
    """Divide *area* into *count* rooms, each time across its longer side."""
    x0, y0, x1, y1 = area
    if min(x1 - x0, y1 - y0) < _MIN_ROOM_SIDE:
        raise _UnusablePlanError
    if count == 1:
        if max(x1 - x0, y1 - y0) > 2.6 * min(x1 - x0, y1 - y0):
            raise _UnusablePlanError
        return [area]
    first = count // 2 if random.random() < 0.5 else count - count // 2
    part = first / count + random.uniform(-0.08, 0.08)
    if x1 - x0 >= y1 - y0:
        cut = _round_to_grid(x0 + part * (x1 - x0))
        halves = (x0, y0, cut, y1), (cut, y0, x1, y1)
    else:
        cut = _round_to_grid(y0 + part * (y1 - y0))
        halves = (x0, y0, x1, cut), (x0, cut, x1, y1)
    return [*_split_area(random, halves[0], first), *_split_area(random, halves[1], count - first)]


def _find_shared_walls(first: Room, second: Room) -> Iterator[_WallSection]:
    """Yield the wall between two rooms, if a door fits into it."""
    for along_x in (True, False):
        i, j = (0, 1) if along_x else (1, 0)
        a, b = first.area, second.area
        begin, end = max(a[i], b[i]), min(a[i + 2], b[i + 2])
        for offset in {a[j], a[j + 2]} & {b[j], b[j + 2]}:
            if end - begin >= DOOR_WIDTHS[0] + 2 * _MIN_WALL_BESIDE_DOOR + _WALL_THICKNESS:
                yield _WallSection(begin, end, offset, along_x)


def _draw_door(random: np.random.Generator, wall: _WallSection) -> Door:
    """Draw a door in a wall: its width and its place."""
    margin = _WALL_THICKNESS / 2 + _MIN_WALL_BESIDE_DOOR
    room = wall.end - wall.begin - 2 * _MIN_WALL_BESIDE_DOOR - _WALL_THICKNESS
    widths = [width for width in DOOR_WIDTHS if width <= room]
    if not widths:
        raise _UnusablePlanError
    width = widths[int(random.integers(len(widths)))]
    begin = _round_to_grid(wall.begin + margin + random.uniform(0.0, room - width))
    middle = begin + width / 2
    return Door((middle, wall.offset) if wall.along_x else (wall.offset, middle), width, wall.along_x)


def _create_walls(plan: FloorPlan) -> list[dict[str, Any]]:
    """Return the walls of all rooms, with gaps at the doors."""
    lines: dict[tuple[bool, float], list[tuple[float, float]]] = {}
    for room in plan.rooms:
        x0, y0, x1, y1 = room.area
        for y in (y0, y1):
            lines.setdefault((True, y), []).append((x0, x1))
        for x in (x0, x1):
            lines.setdefault((False, x), []).append((y0, y1))
    objects: list[dict[str, Any]] = []
    for (along_x, offset), spans in sorted(lines.items()):
        # The ends of walls along x fill the corners.
        extension = _WALL_THICKNESS / 2 if along_x else -_WALL_THICKNESS / 2
        gaps = sorted(
            (door.middle[not along_x] - door.width / 2, door.middle[not along_x] + door.width / 2)
            for door in plan.doors
            if door.along_x == along_x and door.middle[along_x] == offset
        )
        for low, high in _join_spans(spans):
            openings = itertools.chain.from_iterable(gap for gap in gaps if low < gap[0] < high)
            ends = [low - extension, *openings, high + extension]
            for begin, end in zip(ends[::2], ends[1::2], strict=True):
                wall = _WallSection(begin, end, offset, along_x)
                objects.append(_create_wall(f"wall_{len(objects) + 1}", wall))
    return objects


def _join_spans(spans: list[tuple[float, float]]) -> Iterator[tuple[float, float]]:
    """Yield the unions of spans that touch or overlap."""
    low, high = min(spans)
    for begin, end in sorted(spans):
        if begin > high:
            yield low, high
            low = begin
        high = max(high, end)
    yield low, high


def _create_wall(name: str, wall: _WallSection) -> dict[str, Any]:
    middle, length = round((wall.begin + wall.end) / 2, 4), round(wall.end - wall.begin, 4)
    position, size = [middle, wall.offset], [length, _WALL_THICKNESS]
    if not wall.along_x:
        position, size = position[::-1], size[::-1]
    return {
        "name": name,
        "kind": "box",
        "position": position,
        "size": [*size, _WALL_HEIGHT],
        "color": _WALL_COLOR,
    }


def _round_to_grid(length: float) -> float:
    """Return the nearest multiple of the grid (m)."""
    return round(round(length / _GRID_STEP) * _GRID_STEP, 3)


def _furnish_plan(plan: FloorPlan, random: np.random.Generator, description: str) -> dict[str, Any]:
    """Return the world of *plan* with furniture, waypoints and a start pose.

    Raises:
        _UnusablePlanError: A room has no place for its waypoint.
    """
    first = plan.rooms[0].area
    world: dict[str, Any] = {
        "description": description,
        "physics_rate": 120,
        "start": {"pose": [(first[0] + first[2]) / 2, (first[1] + first[3]) / 2, 0.0]},
        "objects": _create_walls(plan),
    }
    floor = ClearanceMap.of(parse_world_description(world, "walls"))
    for number, room in enumerate(plan.rooms):
        if not len(_find_waypoint_cells(floor, room, plan.doors)):
            raise _UnusablePlanError
        floor = _furnish_room(
            world["objects"], floor, plan.doors, room, f"{room.kind.replace(' ', '_')}_{number}", random
        )
    places: list[list[Point]] = [
        [
            (round(x, 3), round(y, 3))
            for x, y in floor.map.centers(*_find_waypoint_cells(floor, room, plan.doors).T).tolist()
        ]
        for room in plan.rooms
    ]
    start = _draw_waypoint(places[0], [], floor, random)
    # A charger stands at a wall: of some places the one with the least clearance.
    charger = min(
        (_draw_waypoint(places[0], [start], floor, random) for _ in range(10)),
        key=lambda at: floor.clearance_at(*at),
    )
    visited = places[1:] if plan.rooms[0].kind == "corridor" else places
    route = _order_route(start, [_draw_waypoint(cells, [start, charger], floor, random) for cells in visited])
    world["waypoints"] = {
        "start": list(start),
        "recharge": list(charger),
        **{f"wp{number}": list(place) for number, place in enumerate(route, 1)},
    }
    _move_origin(world, (_round_to_grid(start[0]), _round_to_grid(start[1])))
    return {key: world[key] for key in ("description", "physics_rate", "start", "waypoints", "objects")}


def _move_origin(world: dict[str, Any], start: Point) -> None:
    """Make *start* the origin, where the robot starts: a map that the robot makes has its origin there."""
    world["start"] = {"pose": [0, 0, 0]}
    world["waypoints"]["start"] = list(start)
    for place in (*world["waypoints"].values(), *(item["position"] for item in world["objects"])):
        place[:2] = [round(place[0] - start[0], 4), round(place[1] - start[1], 4)]


def _draw_waypoint(
    cells: Sequence[Point], chosen: Sequence[Point], floor: ClearanceMap, random: np.random.Generator
) -> Point:
    """Draw a place that is apart from *chosen*, if there is one, and has more clearance than most places."""
    drawn = [cells[int(random.integers(len(cells)))] for _ in range(30)]
    apart = [at for at in drawn if all(math.dist(at, place) >= _MIN_WAYPOINT_DISTANCE for place in chosen)]
    return max((apart or drawn)[:4], key=lambda at: floor.clearance_at(*at))


def _order_route(start: Point, places: list[Point]) -> list[Point]:
    """Return *places* in the order of a walk that always continues to the nearest place."""
    left, route, here = list(places), [], start
    while left:
        here = min(left, key=lambda place: math.dist(place, here))
        left.remove(here)
        route.append(here)
    return route


def _find_waypoint_cells(floor: ClearanceMap, room: Room, doors: Sequence[Door]) -> NDArray[np.intp]:
    """Return the rows and columns, shape `(n, 2)`, of the cells of *room* at which a waypoint may be.

    There are none if the doors are not connected with each other.
    """
    _, labels = cv2.connectedComponents(
        (floor.clearances >= MIN_WAY_CLEARANCE).astype(np.uint8), connectivity=4
    )
    regions = {int(labels[floor.map.cell(*door.middle)]) for door in doors}
    if len(regions) != 1 or 0 in regions:
        return np.empty((0, 2), dtype=np.intp)
    x0, y0, x1, y1 = room.inside
    (row, col), (last_row, last_col) = floor.map.cell(x0, y0), floor.map.cell(x1, y1)
    part = np.s_[row : last_row + 1, col : last_col + 1]
    is_usable = (labels[part] == regions.pop()) & (floor.clearances[part] >= MIN_WAYPOINT_CLEARANCE)
    cells: NDArray[np.intp] = np.argwhere(is_usable) + np.array((row, col))
    return cells


def _furnish_room(
    objects: list[dict[str, Any]],
    floor: ClearanceMap,
    doors: Sequence[Door],
    room: Room,
    name: str,
    random: np.random.Generator,
) -> ClearanceMap:
    """Add furniture to *objects*, and return the clearance map with it.

    Args:
        objects: The objects of the world.
        floor: The clearance map without the furniture.
        doors: All doors of the world.
        name: The beginning of the objects' names.
        random: The source of the random pieces and places.
    """
    occupied_areas: list[Rectangle] = []
    count = 0
    for draw, least, most in _FURNITURE[room.kind]:
        for _ in range(int(random.integers(least, most + 1))):
            for _ in range(_MAX_PLACEMENT_ATTEMPTS):
                piece = draw(random)
                anchor, quarter_turns = _draw_placement(room, piece, random)
                occupied = _occupied_area(piece, anchor, quarter_turns)
                if not _is_free(occupied, room, [*occupied_areas, *(door.free_area() for door in doors)]):
                    continue
                furnished = floor.with_obstacle(_create_obstacle(occupied))
                if len(_find_waypoint_cells(furnished, room, doors)):
                    count += 1
                    floor = furnished
                    occupied_areas.append(occupied)
                    objects += [
                        _create_object(part, f"{name}_{count}", anchor, quarter_turns) for part in piece.parts
                    ]
                    break
    return floor


def _draw_placement(room: Room, piece: Furniture, random: np.random.Generator) -> tuple[Point, int]:
    """Draw a place for a piece: the position (m) of its origin, and its heading in quarter turns."""
    x0, y0, x1, y1 = room.inside
    if piece.central:
        quarter_turns = int((x1 - x0 < y1 - y0) == (piece.width >= piece.depth))
        x, y = (x0 + x1) / 2 + random.uniform(-0.5, 0.5), (y0 + y1) / 2 + random.uniform(-0.5, 0.5)
        back = _rotate((0.0, -piece.depth / 2), quarter_turns)
        return (round(x + back[0], 3), round(y + back[1], 3)), quarter_turns
    quarter_turns = int(random.integers(4))
    low, high = (x0, x1) if quarter_turns % 2 == 0 else (y0, y1)
    low, high = low + piece.width / 2 + _FURNITURE_GAP, high - piece.width / 2 - _FURNITURE_GAP
    corner = random.random()
    along = low if corner < 0.25 else high if corner < 0.5 else random.uniform(min(low, high), max(low, high))
    along = round(along, 3)
    at = (
        (along, y0 + _FURNITURE_GAP),
        (x1 - _FURNITURE_GAP, along),
        (along, y1 - _FURNITURE_GAP),
        (x0 + _FURNITURE_GAP, along),
    )[quarter_turns]
    return (round(at[0], 3), round(at[1], 3)), quarter_turns


def _rotate(point: Point, quarter_turns: int) -> Point:
    """Return *point* turned counter-clockwise by *quarter_turns* quarter turns around the origin."""
    x, y = point
    return ((x, y), (-y, x), (-x, -y), (y, -x))[quarter_turns]


def _occupied_area(piece: Furniture, anchor: Point, quarter_turns: int) -> Rectangle:
    """Return the area (m) of a piece of furniture at a place."""
    corners = [
        _rotate((x, y), quarter_turns)
        for x in (-piece.width / 2, piece.width / 2)
        for y in (0.0, piece.depth)
    ]
    xs, ys = zip(*corners, strict=True)
    return anchor[0] + min(xs), anchor[1] + min(ys), anchor[0] + max(xs), anchor[1] + max(ys)


def _is_free(occupied: Rectangle, room: Room, occupied_areas: Sequence[Rectangle]) -> bool:
    """Return whether *occupied* is inside *room*, and apart from the areas *occupied_areas*."""
    x0, y0, x1, y1 = occupied
    low_x, low_y, high_x, high_y = room.inside
    if x0 < low_x or y0 < low_y or x1 > high_x or y1 > high_y:
        return False
    return all(
        x1 + _FURNITURE_GAP <= other[0]
        or other[2] + _FURNITURE_GAP <= x0
        or y1 + _FURNITURE_GAP <= other[1]
        or other[3] + _FURNITURE_GAP <= y0
        for other in occupied_areas
    )


def _create_obstacle(occupied: Rectangle) -> WorldObject:
    """Return a box that fills *occupied* (m)."""
    x0, y0, x1, y1 = occupied
    size, place = (x1 - x0, y1 - y0, 1.0), ((x0 + x1) / 2, (y0 + y1) / 2, 0.0)
    return WorldObject("furniture", "box", size, place, 0.0, 0.0, (0, 0, 0, 255))


def _create_object(part: Part, prefix: str, anchor: Point, quarter_turns: int) -> dict[str, Any]:
    """Return *part* of a piece of furniture as an object of a world file."""
    dx, dy = _rotate(part.position[:2], quarter_turns)
    width, depth, height = part.size if quarter_turns % 2 == 0 else (part.size[1], part.size[0], part.size[2])
    position = [round(anchor[0] + dx, 3), round(anchor[1] + dy, 3)]
    placed: dict[str, Any] = {"name": f"{prefix}_{part.name}", "kind": part.kind}
    placed["position"] = [*position, part.position[2]] if part.position[2] else position
    if part.kind == "cylinder":
        placed |= {"radius": round(width / 2, 3), "height": round(height, 3)}
    else:
        placed["size"] = [round(width, 3), round(depth, 3), round(height, 3)]
    if part.look:
        placed["look"] = part.look
    return {**placed, "color": part.color}
