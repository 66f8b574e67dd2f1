"""The camera: pinhole model, depth, and pictures like those of the engine's renderer."""

import math
from dataclasses import replace

import numpy as np
import pybullet
import pytest

from btcore_robot.rigid_transform import Transform
from btcore_robot.robot import CameraImage, CameraInfo
from btcore_sim.camera import CameraSettings
from btcore_sim.renderer import SKY, Renderer
from btcore_sim.simulated_robot import SimulatedRobot
from btcore_sim.visible_faces import box_faces, shape_faces
from tests.sim.conftest import MakeObject, RobotAt, Steer

SIZE = CameraSettings(160, 120, 10.0)
RED = (230, 20, 20, 255)


def engines(body: SimulatedRobot) -> tuple[np.ndarray, np.ndarray]:
    """Return the picture of the engine's renderer: the body in each pixel, and the depth (m)."""
    eye, turned = body._camera.pose(body.physics_body, body._camera_link)
    axes = np.array(pybullet.getMatrixFromQuaternion(turned)).reshape(3, 3)
    lens = body.camera_info
    view = pybullet.computeViewMatrix(eye, (np.array(eye) + axes[:, 0]).tolist(), axes[:, 2].tolist())
    angle = math.degrees(2 * math.atan(lens.height / 2 / lens.fy))
    projection = pybullet.computeProjectionMatrixFOV(angle, lens.width / lens.height, lens.near, lens.far)
    image = pybullet.getCameraImage(
        lens.width,
        lens.height,
        view,
        projection,
        renderer=pybullet.ER_TINY_RENDERER,
        physicsClientId=body.world.client,
    )
    shape = (lens.height, lens.width)
    near, far = lens.near, lens.far
    depth = far * near / (far - (far - near) * np.asarray(image[3]).reshape(shape))
    return np.asarray(image[4]).reshape(shape), depth


@pytest.mark.parametrize("look", [(0.0, 0.0), (0.4, -0.5), (-0.9, 0.2), (0.0, -1.0)])
def test_depth_agrees_with_the_engines_renderer(
    robot_at: RobotAt,
    steer: Steer,
    box: MakeObject,
    drum: MakeObject,
    look: tuple[float, float],
) -> None:
    body = robot_at(
        box(4.0, 0.0, (0.2, 9.0, 2.4)),
        box(2.5, 1.0, (0.6, 0.8, 0.9), yaw=0.7, name="crate"),
        drum(2.2, -0.8, 0.3),
        drum(1.6, 0.5, 0.15, mass=3.0, name="bin"),
        camera=SIZE,
    )
    body.move_head(*look)
    steer(body, 1.5, None)
    ours = body.camera().depth
    seen, theirs = engines(body)
    assert np.isfinite(ours).mean() > 0.3
    hit = (seen >= 0) & np.isfinite(ours)
    assert (hit | (seen < 0)).mean() > 0.97
    # Along an outline the two may be a pixel apart, and a drum is a prism here. PyBullet's renderer looks
    # through a pixel's corner, btcore's renderer through its middle.
    off = (np.abs(ours - theirs) / theirs)[hit]
    assert (off < 0.03).mean() > 0.94
    assert np.median(off) < 0.01


def test_the_depth_of_the_floor_follows_from_the_geometry(robot_at: RobotAt, steer: Steer) -> None:
    body = robot_at(camera=SIZE)
    body.move_head(0.3, -0.6)
    steer(body, 1.5, None)
    depth, lens = body.camera().depth, body.camera_info
    eye, turned = body._camera.pose(body.physics_body, body._camera_link)
    rotation = Transform(quaternion=turned).rotation
    for row, column in ((60, 80), (119, 0), (90, 159), (30, 40)):
        ray = rotation @ (1.0, (lens.cx - column) / lens.fx, (lens.cy - row) / lens.fy)
        assert depth[row, column] == pytest.approx(-eye[2] / ray[2], rel=1e-4)


def test_the_lens_is_a_pinhole_of_63_degrees(robot_at: RobotAt) -> None:
    lens = robot_at(camera=CameraSettings(640, 480, 10.0)).camera_info
    assert (lens.width, lens.height, lens.rate) == (640, 480, 10.0)
    assert lens.fx == lens.fy == pytest.approx(522.19, abs=0.01)
    assert (lens.cx, lens.cy) == (319.5, 239.5)
    assert lens.frame == "head_front_camera_rgb_optical_frame"


def test_without_a_camera_there_is_no_camera_info(robot_at: RobotAt) -> None:
    assert robot_at().camera_info is None


def test_picture_has_depth_along_z_or_infinity(robot_at: RobotAt, box: MakeObject) -> None:
    body = robot_at(box(3.1, 0.0, (0.2, 1.0, 2.0)), camera=SIZE)
    picture: CameraImage = body.camera()
    assert picture.depth.dtype == np.float32
    assert picture.depth.shape == picture.rgb.shape[:2] == (120, 160)
    face = picture.depth[55:65, 70:90]
    assert face == pytest.approx(3.0 - 0.2158, abs=0.03)
    assert np.ptp(face[5]) < 1e-3, "depth is along z, not along the ray"
    assert picture.depth[0, 0] == np.inf
    assert tuple(picture.rgb[0, 0]) == SKY


def test_object_is_drawn_at_place_by_pinhole_model(robot_at: RobotAt, box: MakeObject) -> None:
    far = replace(box(3.0, 0.6, (0.1, 0.1, 0.1)), position=(3.0, 0.6, 1.0165), color=RED)
    body = robot_at(far, camera=CameraSettings(320, 240, 10.0))
    picture, lens = body.camera(), body.camera_info
    eye, turned = body._camera.pose(body.physics_body, body._camera_link)
    x, y, z = Transform(quaternion=turned).rotation.T @ (np.array((2.95, 0.6, 1.0665)) - eye)
    rows, columns = np.nonzero(picture.rgb[:, :, 0].astype(int) > picture.rgb[:, :, 1].astype(int) + 60)
    assert columns.mean() == pytest.approx(lens.cx - lens.fx * y / x, abs=0.6)
    assert rows.mean() == pytest.approx(lens.cy - lens.fy * z / x, abs=0.6)


def test_a_picture_is_read_only(robot_at: RobotAt) -> None:
    picture = robot_at(camera=SIZE).camera()
    for pixels in (picture.rgb, picture.depth):
        with pytest.raises(ValueError, match="read-only"):
            pixels[0, 0] = 0


def test_a_movable_object_is_seen_at_its_current_place(
    robot_at: RobotAt, steer: Steer, box: MakeObject
) -> None:
    crate = replace(box(2.0, 0.0, (0.4, 0.4, 1.6), mass=5.0), color=RED)
    body = robot_at(crate, camera=SIZE)
    assert body.camera().depth[60, 80] == pytest.approx(1.8 - 0.2158, abs=0.03)
    pybullet.resetBasePositionAndOrientation(
        body.world.movable[0], [3.0, 0.0, 0.8], [0, 0, 0, 1], physicsClientId=body.world.client
    )
    steer(body, 0.1, None)
    assert body.camera().depth[60, 80] == pytest.approx(2.8 - 0.2158, abs=0.03)


def test_the_camera_sees_the_robot_when_it_looks_down(robot_at: RobotAt, steer: Steer) -> None:
    body = robot_at(camera=SIZE)
    floor = body.camera().depth[119, 80]
    body.move_head(0.0, -1.0)
    steer(body, 1.0, None)
    assert body.camera().depth[119, 80] < floor / 2


FACTS = CameraInfo(64, 48, 50.0, 50.0, 31.5, 23.5, 0.1, 20.0, 10.0, "lens")


def painted(*boxes: tuple[tuple[float, float, float], tuple[float, float, float], int]) -> tuple:
    """Draw boxes (size, place, shade of grey) before a camera at the origin that faces z."""
    shapes = [Transform(place).apply(box_faces(size)) for size, place, _ in boxes]
    colors = np.concatenate([np.tile((shade, shade, shade, 255.0), (6, 1)) for *_, shade in boxes])
    return Renderer(FACTS).draw(np.concatenate(shapes), colors, np.zeros(3), np.eye(3))


def test_the_nearer_of_two_objects_is_seen_in_any_drawing_order() -> None:
    near, far = ((1.0, 1.0, 0.2), (0.0, 0.0, 2.1), 40), ((4.0, 4.0, 0.2), (0.0, 0.0, 4.1), 200)
    for order in ((near, far), (far, near)):
        rgb, depth = painted(*order)
        assert depth[24, 32] == pytest.approx(2.0)
        assert depth[2, 32] == pytest.approx(4.0)
        assert rgb[24, 32, 0] <= 40 < rgb[2, 32, 0]


def test_intersecting_objects_are_separated_where_their_depths_are_equal() -> None:
    turned = (0.0, math.sin(0.3), 0.0, math.cos(0.3))
    slanted = Transform((0.0, 0.0, 3.0), turned).apply(box_faces((4.0, 0.4, 0.02)))
    flat = Transform((0.0, 0.0, 3.0)).apply(box_faces((4.0, 4.0, 0.02)))
    colors = np.repeat([(40.0, 40.0, 40.0, 255.0), (200.0, 200.0, 200.0, 255.0)], 6, axis=0)
    rgb, _ = Renderer(FACTS).draw(np.concatenate((slanted, flat)), colors, np.zeros(3), np.eye(3))
    row = rgb[24, :, 0] < 100
    assert row[40:50].all() != row[14:24].all()


def test_only_the_part_of_an_object_ahead_of_the_lens_is_drawn() -> None:
    _, depth = painted(((0.2, 0.2, 10.0), (0.6, 0.0, 0.0), 90))
    assert np.isfinite(depth[24, 45:63]).all()
    assert depth[24, 60] == pytest.approx(0.5 / ((60 - 31.5) / 50.0), rel=0.01)


def test_objects_beyond_the_far_plane_or_before_the_near_plane_are_not_drawn() -> None:
    assert (painted(((50.0, 50.0, 1.0), (0.0, 0.0, 25.0), 90))[1] == np.inf).all()
    assert (painted(((0.05, 0.05, 0.05), (0.0, 0.0, 0.06), 90))[1] == np.inf).all()


@pytest.mark.parametrize(
    ("kind", "size"), [("box", (1.0, 2.0, 3.0)), ("cylinder", (1.0, 1.0, 2.0)), ("sphere", (0.7,))]
)
def test_faces_close_the_shape_and_face_outwards(kind: str, size: tuple[float, ...]) -> None:
    found = shape_faces(kind, size)
    normals = np.cross(found[:, 2] - found[:, 0], found[:, 3] - found[:, 1]) / 2
    assert normals.sum(axis=0) == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
    assert (np.einsum("nk,nk->n", normals, found.mean(axis=1)) > 0.0).all()
    volume = np.einsum("nk,nk->n", normals, found.mean(axis=1)).sum() / 3
    true = {"box": 6.0, "cylinder": math.pi / 2, "sphere": 4 / 3 * math.pi * 0.343}[kind]
    assert volume == pytest.approx(true, rel=0.12)
