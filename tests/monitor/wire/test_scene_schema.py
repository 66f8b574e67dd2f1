"""The data of a scene on the wire: valid data is transmitted, and invalid data is reported."""

import math
import zlib
from contextlib import suppress
from dataclasses import asdict, replace
from typing import Any

import cv2
import msgpack
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from btcore_monitor.serve.queueing_observer import compute_weight, merge_scenes
from btcore_monitor.serve.run_channel_server import to_jpeg
from btcore_monitor.wire.errors import ProtocolError
from btcore_monitor.wire.run_channel import MovingSceneMessage, StaticSceneMessage, decode, encode
from btcore_scene import (
    UPRIGHT,
    Area,
    Arrow,
    BoundingBox,
    Box,
    Camera,
    Cylinder,
    Detection,
    Frame,
    Grid,
    Laser,
    Mesh,
    MovingScene,
    Picture,
    Place,
    Poses,
    Scan,
    Sphere,
    StaticScene,
    float32,
)

TREE_ID = "13d1ef3eabd249e29d185f4ad8d7fd3a"
ROWS = np.array([[1.0, 2.0, 0.5]], dtype="<f4").tobytes()
COSTS = Grid(
    name="global_costmap",
    kind="costs",
    frame="map",
    resolution=0.05,
    origin=(-1.0, 2.0),
    size=(40, 30),
    cells=bytes(1200),
)
CAMERA = Picture(name="camera", stamp=7, size=(4, 2), format="rgb8", data=bytes(range(24)))
MOVING = MovingScene(
    stamp=5,
    frames=(Frame("odom", "map", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)),),
    scan=Scan(stamp=5, ranges=b"\x00\x00\x80\x3f"),
    velocity=(0.1, 0.0),
    battery=80.0,
    grids=(COSTS,),
    poses=(Poses(name="path", kind="path", frame="map", rows=ROWS),),
    arrows=(Arrow(name="push", frame="base_link", start=(0, 0, 0), end=(1, 0, 0)),),
    boxes=(BoundingBox(name="table", frame="map", position=(0, 0, 0.5), size=(2.0, 1.0, 1.0)),),
    pictures=(CAMERA,),
    detections=(Detection(picture="camera", name="object", box=(0, 0, 2, 2)),),
    notes={"localisation": "sure"},
    collisions=0,
    grazes=1,
)
MESH = Mesh(
    name="hull",
    frame="base_link",
    color=(1, 2, 3, 255),
    vertices=float32((0, 0, 0, 1, 0, 0, 0, 1, 0)),
    normals=float32((0, 0, 1) * 3),
    triangles=b"\0\0\0\0\1\0\0\0\2\0\0\0",
)
STATIC = StaticScene(
    frame="map",
    parts=(
        Box(name="wall", size=(1.0, 2.0, 3.0), position=(0.0, 0.0, 1.5)),
        Cylinder(radius=0.2, length=0.5, position=(0, 0, 0), quaternion=UPRIGHT),
        Sphere(radius=0.1, position=(0, 0, 0), color=(1, 2, 3, 255)),
    ),
    meshes=(MESH,),
    laser=Laser(frame="laser", angle_min=-1.0, angle_increment=0.01, range_max=25.0),
    places=(Place(name="wp1", position=(1.0, 2.0, 0.0)),),
    areas=(Area(name="table", corners=(0.0, 0.0, 1.0, 1.0)),),
    cameras=(Camera(name="camera", frame="optical", size=(32, 24), focal=(30.0, 30.0)),),
    grids=(replace(COSTS, name="map", kind="occupancy"),),
    battery=100.0,
)
GRID, PICTURE, SURFACE = asdict(COSTS), asdict(CAMERA), asdict(MESH)


def moving(**changed: object) -> MovingSceneMessage:
    return MovingSceneMessage(TREE_ID, 1, 2, 3, replace(MOVING, **changed))


def test_a_scene_is_unchanged_after_decoding_and_its_cells_are_compressed() -> None:
    assert decode(encode(moving())) == moving()
    assert decode(encode(StaticSceneMessage(TREE_ID, STATIC))) == StaticSceneMessage(TREE_ID, STATIC)
    sent = msgpack.unpackb(encode(moving()))["data"]["grids"][0]
    assert sent["coding"] == "zlib"
    assert len(sent["cells"]) < 50


def test_a_grid_of_a_single_cell_is_unchanged_after_decoding() -> None:
    message = moving(grids=(replace(COSTS, size=(1, 1), cells=b"7"),))
    assert decode(encode(message)) == message


def test_a_scene_is_encoded_as_a_plain_map_without_unset_fields() -> None:
    data = msgpack.unpackb(encode(StaticSceneMessage(TREE_ID, replace(STATIC, grids=(), meshes=()))))["data"]
    assert data == {
        "frame": "map",
        "parts": [
            {"name": "wall", "kind": "box", "size": [1.0, 2.0, 3.0], "position": [0.0, 0.0, 1.5]},
            {
                "kind": "cylinder",
                "radius": 0.2,
                "length": 0.5,
                "position": [0, 0, 0],
                "quaternion": [0.0, 0.0, 0.0, 1.0],
            },
            {"kind": "sphere", "radius": 0.1, "position": [0, 0, 0], "color": [1, 2, 3, 255]},
        ],
        "laser": {"frame": "laser", "angle_min": -1.0, "angle_increment": 0.01, "range_max": 25.0},
        "places": [{"name": "wp1", "position": [1.0, 2.0, 0.0]}],
        "areas": [{"name": "table", "corners": [0.0, 0.0, 1.0, 1.0]}],
        "cameras": [{"name": "camera", "frame": "optical", "size": [32, 24], "focal": [30.0, 30.0]}],
        "battery": 100.0,
    }
    scan = Scan(ranges=float32([1.0]))
    data = msgpack.unpackb(encode(moving(scan=scan, arrows=(), boxes=None, grids=(), pictures=())))["data"]
    assert data == {
        "stamp": 5,
        "frames": [["odom", "map", [0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]],
        "scan": {"ranges": b"\x00\x00\x80\x3f"},
        "velocity": [0.1, 0.0],
        "battery": 80.0,
        "poses": [{"name": "path", "kind": "path", "frame": "map", "rows": ROWS}],
        "arrows": [],
        "detections": [{"picture": "camera", "name": "object", "box": [0, 0, 2, 2]}],
        "notes": {"localisation": "sure"},
        "collisions": 0,
        "grazes": 1,
    }


def test_unknown_fields_are_passed_on() -> None:
    sent = moving(extra={"smell": {"of": "coffee"}})
    assert msgpack.unpackb(encode(sent))["data"]["smell"] == {"of": "coffee"}
    assert decode(encode(sent)).data.extra["smell"] == {"of": "coffee"}


@pytest.mark.parametrize(
    ("key", "entries", "expected_message"),
    [
        ("grids", [{**GRID, "kind": "soup"}], "'kind' of 'grids' .* occupancy or costs, and got 'soup'"),
        ("grids", [{**GRID, "size": [40, 31]}], "expected 1240 bytes of 'cells' for 'global_costmap'"),
        ("grids", [{**GRID, "size": [0, 31]}], "got 0 times 31"),
        ("grids", [{**GRID, "size": [-2, -2]}], "got -2 times -2"),
        ("grids", [{**GRID, "size": [1 << 20, 1 << 20]}], "expected at most 33554432 cells and pixels"),
        ("grids", [{**GRID, "size": [5000, 5000]}] * 2, "expected at most 33554432 cells and pixels"),
        ("grids", [{**GRID, "resolution": "fine"}], "'resolution' of 'grids' .* a number, and got 'fine'"),
        ("grids", [{**GRID, "coding": "morse"}], "coded by zlib, and got 'morse'"),
        ("grids", [{**GRID, "coding": "zlib"}], "expected compressed 'cells' for 'global_costmap'"),
        ("grids", GRID, "'grids' of a 'moving' message to be a list, and got dict"),
        ("poses", [{"name": "path", "kind": "path", "rows": ROWS + b"1234"}], "rows of three float32"),
        ("poses", [{"name": "path", "rows": ROWS}], "expected 'kind' of 'poses' .* got nothing"),
        ("scan", {"ranges": b"123"}, "float32, and got 3 bytes"),
        ("pictures", [{**PICTURE, "size": [5, 2]}], "expected 30 bytes of 'data' for 'camera', and got 24"),
        ("pictures", [{**PICTURE, "size": [1 << 20, 1 << 20]}], "expected at most 33554432 cells and pixels"),
        ("frames", [["odom", "map", [0, 0], [0, 0, 0, 1]]], "the position in 'frames' .* 3 values"),
        ("arrows", [{"name": "push", "start": [0, 0, 0]}], "expected 'end' of 'arrows'"),
        ("arrows", [{"name": "a", "start": [0] * 3, "end": [1] * 3, "color": [256] * 4}], "from 0 to 255"),
        ("battery", "full", "'battery' of a 'moving' message to be a number, and got 'full'"),
        ("notes", {"goal": 3}, "'notes' of a 'moving' message to be text, and got 3"),
        ("parts", [{"kind": "box", "position": [0, 0, 0]}], "expected 'size' of one of 'parts'"),
        ("meshes", [{**SURFACE, "normals": b""}], "expected a normal for each of the 3 vertices"),
        ("meshes", [{**SURFACE, "triangles": b"\3" + bytes(11)}], "triangles of 3 vertices, and got .* 3"),
        ("meshes", [{**SURFACE, "triangles": bytes(8)}], "rows of three uint32, and got 8 bytes"),
        ("parts", [{"kind": "box", "position": [0] * 3, "size": [math.nan] * 3}], "a number of a usual size"),
        ("parts", [{"kind": "blob"}], "box or cylinder or sphere, and got 'blob'"),
    ],
)  # fmt: skip
def test_invalid_data_is_reported(key: str, entries: Any, expected_message: str) -> None:
    static = StaticSceneMessage(TREE_ID, STATIC)
    whole = msgpack.unpackb(encode(static if key in ("parts", "meshes") else moving()))
    whole["data"][key] = entries
    with pytest.raises(ProtocolError, match=expected_message):
        decode(msgpack.packb(whole))


def test_cells_that_would_fill_the_memory_are_not_unpacked() -> None:
    bomb = zlib.compress(bytes(50_000_000), 9)
    whole = msgpack.unpackb(encode(moving()))
    whole["data"]["grids"] = [{**GRID, "cells": bomb, "coding": "zlib"}]
    with pytest.raises(
        ProtocolError, match="expected 1200 bytes of 'cells' for 'global_costmap', and got 1201"
    ):
        decode(msgpack.packb(whole))


VALUES = st.recursive(
    st.none() | st.integers(-(2**63), 2**64 - 1) | st.floats() | st.text(max_size=5) | st.binary(max_size=24),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)


@given(data=st.data())
@settings(max_examples=3 * settings().max_examples)
def test_any_value_in_a_scene_raises_nothing_but_a_protocol_error(data: Any) -> None:
    whole = msgpack.unpackb(
        encode(data.draw(st.sampled_from([moving(), StaticSceneMessage(TREE_ID, STATIC)])))
    )
    scene = whole["data"]
    key = data.draw(st.sampled_from(sorted(scene)))
    entry = scene[key][0] if isinstance(scene[key], list) else scene[key]
    if isinstance(entry, dict) and data.draw(st.booleans()):
        entry[data.draw(st.sampled_from(sorted(entry)))] = data.draw(VALUES)
    else:
        scene[key] = data.draw(VALUES)
    with suppress(ProtocolError):
        decode(msgpack.packb(whole))


def test_pictures_are_sent_as_jpeg_and_look_the_same() -> None:
    rgb = np.zeros((48, 64, 3), dtype=np.uint8)
    rgb[:, :32] = (200, 40, 10)
    rgb[:, 32:] = (10, 60, 220)
    picture = replace(CAMERA, size=(64, 48), data=rgb.tobytes())
    scene = MovingScene(pictures=[to_jpeg(picture)], battery=3.0)
    sent = decode(encode(MovingSceneMessage(TREE_ID, 1, 2, 3, scene))).data
    assert sent.battery == 3.0
    assert sent.pictures[0].format == "jpeg"
    assert len(sent.pictures[0].data) < rgb.size / 5
    seen = cv2.imdecode(np.frombuffer(sent.pictures[0].data, np.uint8), cv2.IMREAD_COLOR)[:, :, ::-1]
    assert seen[24, 10] == pytest.approx(rgb[24, 10], abs=8)
    assert seen[24, 50] == pytest.approx(rgb[24, 50], abs=8)
    assert to_jpeg(sent.pictures[0]) is sent.pictures[0]


def test_scenes_of_several_sources_are_merged() -> None:
    here, there = Frame("base_link", "map", (0, 0, 0), UPRIGHT), Frame("odom", "map", (0, 0, 0), UPRIGHT)
    body = MovingScene(frames=[here], notes={"body": "warm"}, stamp=1, velocity=(0.1, 0.2))
    mind = MovingScene(
        frames=[there], notes={"mind": "sure", "body": "cold"}, stamp=2, velocity=(3, 4), boxes=()
    )
    assert merge_scenes(MovingScene, [body, mind, MovingScene()]) == MovingScene(
        frames=(here, there), notes={"body": "warm", "mind": "sure"}, stamp=1, velocity=(0.1, 0.2), boxes=()
    )
    assert body.frames == [here]
    assert merge_scenes(StaticScene, []) == StaticScene()
    assert merge_scenes(StaticScene, [StaticScene(), StaticScene(frame="map")]) == StaticScene(frame="map")


def test_a_big_picture_has_the_weight_of_several_scenes() -> None:
    assert compute_weight(MovingScene()) == 1
    picture, grid = replace(CAMERA, data=bytes(320 * 240 * 3)), replace(COSTS, cells=bytes(100_000))
    assert compute_weight(MovingScene(pictures=[picture], grids=[grid])) == 6
