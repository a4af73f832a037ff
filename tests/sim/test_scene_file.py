"""A user's own scene: ten lines that load, models that stand where they were put, complaints that help."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from perception.primitives.errors import InputError
from perception.primitives.pose import Pose3
from sim import scenes
from sim.model_files import read_model
from sim.scene_file import EXAMPLE
from sim.shapes import Box, Solid, distance, outline
from sim.world import World

DOWN = Pose3.from_rotation(np.diag([1.0, -1.0, -1.0]), np.array([2.0, 2.0, 3.0]))


def load(tmp_path, text, seed=0):
    (tmp_path / "mine.toml").write_text(text)
    return scenes.load(str(tmp_path / "mine.toml"), seed)


def heights_below(scene, places):
    """What rays straight down hit, m above the floor."""
    with World(scene, "tiny") as world:
        found = []
        for x, y in places:
            hits = world.rays.cast(np.array([x, y, 2.3]), np.array([[0, 0, -1.0]], np.float32))
            found.append(2.3 - float(hits.distance_m[0]))
    return np.array(found)


def test_the_ten_lines_are_a_scene(tmp_path):
    scene = load(tmp_path, EXAMPLE)
    assert scene.name == "mine"
    assert scene.goals == ((4.4, 2.0),)
    assert [thing.name for thing in scene.obstacles] == ["table"]
    (mover,) = scene.movers
    assert mover.end == pytest.approx((3.6, 3.0))
    assert mover.state(10.0)[:2] == pytest.approx((3.6, 1.5))
    assert scene.landmarks
    np.testing.assert_allclose(
        heights_below(scene, [(2.5, 2.0), (1.5, 1.0)]), [0.5, 0.0], atol=1e-4
    )


def test_the_same_seed_gives_the_same_scene(tmp_path):
    text = EXAMPLE + '[[furniture]]\nkind = "armchair"\nat = [1.0, 3.4]\n'
    assert load(tmp_path, text, 3) == load(tmp_path, text, 3)
    assert load(tmp_path, text, 3) != load(tmp_path, text, 4)


URDF = """<robot name="lamp">
  <link name="foot"><visual><geometry><cylinder radius="0.15" length="0.04"/></geometry>
    <origin xyz="0 0 0.02"/></visual></link>
  <link name="arm"><collision><geometry><box size="0.1 0.1 0.6"/></geometry></collision></link>
  <joint name="tilt" type="fixed"><parent link="foot"/><child link="arm"/>
    <origin xyz="0 0 0.4" rpy="0 1.5707963 0"/></joint>
</robot>"""


def test_a_urdf_stands_where_it_was_put_with_its_joints_at_zero(tmp_path):
    (tmp_path / "lamp.urdf").write_text(URDF)
    text = EXAMPLE + '[[model]]\nfile = "lamp.urdf"\nat = [1.5, 3.0]\nyaw = 90\n'
    scene = load(tmp_path, text)
    lamp = next(thing for thing in scene.obstacles if thing.name.startswith("lamp"))
    assert len(lamp.parts) == 2
    # The arm lies along x of the model, so along y of the world: 30 cm to both sides, its top at 45 cm.
    places = [(1.5, 3.29), (1.5, 2.71), (1.5, 3.31), (1.54, 3.0), (1.60, 3.0), (1.66, 3.0)]
    np.testing.assert_allclose(
        heights_below(scene, places), [0.45, 0.45, 0.0, 0.45, 0.04, 0.0], atol=1e-4
    )


def test_a_mesh_is_as_far_as_the_box_it_was_made_of(tmp_path):
    import open3d as o3d

    mesh = o3d.geometry.TriangleMesh.create_box(0.6, 0.4, 0.3).translate((-0.3, -0.2, 0.0))
    o3d.io.write_triangle_mesh(str(tmp_path / "crate.obj"), mesh)
    (solid,) = read_model(tmp_path / "crate.obj")
    box = Box((0.0, 0.0, 0.15), (0.6, 0.4, 0.3))
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (500, 2))
    np.testing.assert_allclose(distance(solid, points), distance(box, points), atol=1e-6)
    assert (solid.bottom_m, solid.top_m) == pytest.approx((0.0, 0.3))
    ordered = [np.array(sorted(outline(shape).tolist())) for shape in (solid, box)]
    np.testing.assert_allclose(*ordered, atol=1e-6)


def test_a_solid_is_drawn_all_over_and_seen_as_it_is_measured(tmp_path):
    import open3d as o3d

    ball = o3d.geometry.TriangleMesh.create_sphere(0.25, 24).translate((0.0, 0.0, 0.25))
    o3d.io.write_triangle_mesh(str(tmp_path / "ball.ply"), ball)
    text = EXAMPLE.replace("[[box]]", '[[model]]\nfile = "ball.ply"\nat = [2.0, 2.0]\n[[box]]')
    scene = load(tmp_path, text.replace("at = [2.5, 2.0]", "at = [3.2, 3.2]"))
    from perception.primitives.camera import Camera

    camera = Camera.from_view(80, 60, math.radians(40), math.radians(31))
    with World(scene, "tiny") as world:
        drawn = world.rendered_depth(camera, DOWN)
        directions = camera.rays.reshape(-1, 3) @ DOWN.rotation.T
        lengths = np.linalg.norm(directions, axis=1)
        hits = world.rays.cast(DOWN.position, (directions / lengths[:, None]).astype(np.float32))
    cast = (hits.distance_m / lengths).reshape(drawn.shape)
    inside = cast < 2.95
    assert inside.sum() > 100
    rim = np.abs(np.diff(cast, axis=1, prepend=cast[:, :1])) > 0.03
    np.testing.assert_allclose(drawn[inside & ~rim], cast[inside & ~rim], atol=0.01)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("extent", "extnt"), "did you mean extent"),
        (("size = [0.6, 0.8, 0.5]", "size = [0.6, 0.8]"), "size = .*list of 3 numbers"),
        (("size = [0.6, 0.8, 0.5]", "size = [0.6, -0.8, 0.5]"), "positive"),
        (("goals = [[4.4, 2.0]]", "goals = [[9.0, 2.0]]"), "outside the extent"),
        (("goals = [[4.4, 2.0]]", "goals = [[2.5, 2.1]]"), "from 'table'"),
        (("goals = [[4.4, 2.0]]", ""), "goals is missing"),
        (("speed = 0.05", "speed = 0"), "positive speed"),
        (('name = "table"', 'material = "cheese/oak"'), "expected kind/colour"),
        (("[[box]]", "[[box"), "no valid TOML"),
    ],
)
def test_what_is_wrong_is_named_with_what_was_expected(tmp_path, change, said):
    with pytest.raises(InputError, match=said) as caught:
        load(tmp_path, EXAMPLE.replace(*change))
    assert "mine.toml" in str(caught.value)


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("thing.stl", "not a mesh", "no triangles"),
        ("thing.docx", "", "is not read"),
        ("thing.urdf", "<robot><link name='a'><visual/></link></robot>", "no <geometry>"),
        ("thing.urdf", "<robot", "no XML"),
    ],
)
def test_models_that_cannot_be_used_are_refused(tmp_path, name, content, said):
    (tmp_path / name).write_text(content)
    with pytest.raises(InputError, match=said):
        read_model(tmp_path / name)
    with pytest.raises(InputError, match="no such file"):
        read_model(tmp_path / "absent.obj")


def test_solids_turn_with_their_triangles():
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    turned = corners @ Rotation.from_euler("z", 30, degrees=True).as_matrix().T
    solid = Solid(turned, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]))
    assert distance(solid, np.array([[0.1, 0.2], [-1.0, 0.0]]))[0] < 0
