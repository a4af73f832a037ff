"""Scenes from users: the example loads, models are placed correctly, errors state the remedy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from perception.primitives.errors import InputError
from perception.primitives.pose import Pose3
from sim.scenes import catalogue
from sim.scenes.model_files import read_model
from sim.scenes.scene_file import EXAMPLE
from sim.scenes.walker import Walker
from sim.shapes import Box, Solid, distance, outline
from sim.world import World

DOWN = Pose3.from_rotation(np.diag([1.0, -1.0, -1.0]), np.array([2.0, 2.0, 3.0]))


def load(tmp_path, text, seed=0):
    (tmp_path / "mine.toml").write_text(text)
    return catalogue.load(str(tmp_path / "mine.toml"), seed)


def heights_below(scene, places):
    """Heights that vertical rays hit, m above the floor."""
    with World(scene, "tiny") as world:
        found = []
        for x, y in places:
            hits = world.rays.cast(np.array([x, y, 2.3]), np.array([[0, 0, -1.0]], np.float32))
            found.append(2.3 - float(hits.distance_m[0]))
    return np.array(found)


def test_the_example_is_a_scene(tmp_path):
    scene = load(tmp_path, EXAMPLE)
    assert scene.name == "mine"
    assert scene.goals == ((4.4, 2.0),)
    assert [item.name for item in scene.obstacles] == ["table"]
    (moving_object,) = scene.moving_objects
    assert moving_object.end == pytest.approx((3.6, 3.0))
    assert moving_object.state(10.0)[:2] == pytest.approx((3.6, 1.5))
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


def test_a_urdf_is_placed_with_its_joints_at_zero(tmp_path):
    (tmp_path / "lamp.urdf").write_text(URDF)
    text = EXAMPLE + '[[model]]\nfile = "lamp.urdf"\nat = [1.5, 3.0]\nyaw = 90\n'
    scene = load(tmp_path, text)
    lamp = next(item for item in scene.obstacles if item.name.startswith("lamp"))
    assert len(lamp.parts) == 2
    # The arm lies along x of the model, so along y of the world: 30 cm to both sides, its top at 45 cm.
    places = [(1.5, 3.29), (1.5, 2.71), (1.5, 3.31), (1.54, 3.0), (1.60, 3.0), (1.66, 3.0)]
    np.testing.assert_allclose(
        heights_below(scene, places), [0.45, 0.45, 0.0, 0.45, 0.04, 0.0], atol=1e-4
    )


def test_a_box_mesh_has_the_distances_of_its_box(tmp_path):
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


def test_rendered_depth_of_a_solid_agrees_with_ray_casting(tmp_path):
    import open3d as o3d

    ball = o3d.geometry.TriangleMesh.create_sphere(0.25, 24).translate((0.0, 0.0, 0.25))
    o3d.io.write_triangle_mesh(str(tmp_path / "ball.ply"), ball)
    text = EXAMPLE.replace("[[box]]", '[[model]]\nfile = "ball.ply"\nat = [2.0, 2.0]\n[[box]]')
    scene = load(tmp_path, text.replace("at = [2.5, 2.0]", "at = [1.0, 3.2]"))
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
        (("speed = 0.05", "speed = 0"), "speed = 0; expected a number, from 0.001 to 5"),
        (("speed = 0.05", "speed = 1e6"), "speed = 1000000.0; expected a number, from 0.001 to 5"),
        (("to = [3.6, 3.0]", "to = [3.6, 1.0]"), "to = .*; expected another place than from"),
        (
            ("start = [0.6, 2.0, 0]", "start = [0.6, 2.0, 1e300]"),
            r"heading = 1e\+300; expected a number, from -360 to 360",
        ),
        (('name = "table"', 'material = "cheese/oak"'), "expected kind/colour"),
        (("[[box]]", "[[box"), "not valid TOML"),
        (("[0, 0, 5, 4] ", "[0, 0, 0.5, 0.5]"), "0.5 x 0.5 m; each side must be 1 to 50 m"),
        (("[0, 0, 5, 4] ", "[0, 0, 5, 1e6]"), "each side must be 1 to 50 m"),
        (
            ("at = [2.5, 2.0]", "at = [7.0, 2.0]"),
            r"box\]\] 1 'table': reaches 2.4\d m beyond .* widen",
        ),
        (("at = [2.5, 2.0]", "at = [4.8, 2.0]"), "reaches 0.22 m beyond the walls"),
        (("yaw = 20", "albedo = -3"), "'table': albedo = -3; expected a number, from 0 to 1"),
        (("yaw = 20", "albedo = 50"), "albedo = 50; expected a number, from 0 to 1"),
        (("yaw = 20", "above = -2"), "above = -2; expected a number, at least 0"),
        (("[[box]]", "tags = -5\n[[box]]"), "tags = -5; expected a whole number from 0 to 50"),
        (("[[box]]", "tags = 2.7\n[[box]]"), "tags = 2.7; expected a whole number"),
        (("[[box]]", "tags = 51\n[[box]]"), "tags = 51; expected a whole number"),
        (
            ("to = [3.6, 3.0]", "to = [3.6, 7.0]"),
            r"moving_object\]\] 1: the line .* inside the extent",
        ),
        (
            ("to = [3.6, 3.0]", "to = [3.6, 3.95]"),
            "comes to 0.05 m inside the extent .* 0.1 m must",
        ),
        (("to = [3.6, 3.0]", "to = [1.4, 3.0]"), "the line .* from 'table'; .* move one of them"),
        (
            ("from = [3.6, 1.0]", "from = [0.7, 2.0]"),
            r"comes to 0.10 m from the start .* 0.25 m away",
        ),
        (("speed = 0.05", "speed = 0.05\nheight = 0.05"), "height = 0.05; expected .* from 0.1 to"),
        (
            ("[[box]]", "[[area]]\nextent = [2, 1, 1, 2]\n[[box]]"),
            r"area\]\] 1: extent .* each side",
        ),
        (
            ("[[box]]", "[[area]]\nextent = [2, 1, 2, 2]\n[[box]]"),
            r"area\]\] 1: extent .* each side",
        ),
        (
            ("[[box]]", "[[area]]\nextent = [6, 5, 7, 6]\n[[box]]"),
            "must lie within that of the floor",
        ),
        (
            ("[[box]]", "[[area]]\nextent = [4, 3, 6, 6]\n[[box]]"),
            "must lie within that of the floor",
        ),
        (("[0.6, 0.8, 0.5]", "[0.2, 4.4, 0.5]\nabove = 0.1"), "beyond the walls"),
    ],
)
def test_invalid_entries_are_reported_with_the_expected_value(tmp_path, change, said):
    with pytest.raises(InputError, match=said) as caught:
        load(tmp_path, EXAMPLE.replace(*change))
    assert "mine.toml" in str(caught.value)


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("box", r"501 of \[\[box\]\], \[\[cylinder\]\], .*; 500 are the most, leave some out"),
        ("moving_object", r"51 of \[\[moving_object\]\]; 50 are the most, leave some out"),
    ],
)
def test_more_objects_than_a_renderer_can_hold_are_refused(tmp_path, kind, said):
    with pytest.raises(InputError, match=said):
        load(tmp_path, EXAMPLE + f"[[{kind}]]\n" * (500 if kind == "box" else 50))


WALL = """
extent = [0, 0, 5, 4]
start = [1, 2, 0]
goals = [[1, 3.5], [4, 2]]
[[box]]
at = [2.5, {middle}]
size = [{thick}, {length}, 0.4]
above = {above}
"""


@pytest.mark.parametrize("thick", [0.01, 0.3])
def test_an_unreachable_goal_is_refused(tmp_path, thick):
    with pytest.raises(
        InputError, match=r"goal 2 \(4, 2\) is not reachable from the start \(1, 2\)"
    ):
        load(tmp_path, WALL.format(middle=2.0, thick=thick, length=4.0, above=0.0))


@pytest.mark.parametrize(
    ("gap", "above"), [(0.30, 0.0), (0.17, 0.0), (0.0, 0.6)]
)  # the robot is 0.164 m wide and 0.455 m tall
def test_a_reachable_goal_is_accepted(tmp_path, gap, above):
    length = 4.0 - gap
    scene = load(tmp_path, WALL.format(middle=length / 2, thick=0.1, length=length, above=above))
    assert scene.goals[1] == (4.0, 2.0)


def test_a_sufficient_gap_is_passable_at_any_position(tmp_path):
    """Gaps of 0.17 m at 40 positions relative to the cells."""
    for shift in np.linspace(0.0, 0.1, 40):
        low, high = 1.9 + shift, 4.0 - 1.9 - shift - 0.17
        text = WALL.format(middle=low / 2, thick=0.1, length=low, above=0.0)
        text += f"[[box]]\nat = [2.5, {4.0 - high / 2}]\nsize = [0.1, {high}, 0.4]\ntags = 0\n"
        scene = load(tmp_path, text.replace("tags = 0\n", "").replace("start", "tags = 0\nstart"))
        assert scene.goals[1] == (4.0, 2.0)


def test_objects_may_touch_walls_and_each_other(tmp_path):
    """Against a wall, in a corner, and on top of another object."""
    text = EXAMPLE + "[[box]]\nat = [0.25, 0.25]\nsize = [0.5, 0.5, 1.0]\n"
    text += "[[cylinder]]\nat = [0.25, 0.25]\nradius = 0.1\nheight = 0.2\nabove = 1.0\n"
    text += "[[area]]\nextent = [0, 0, 5, 4]\n"
    assert len(load(tmp_path, text).obstacles) == 3


def arch(tmp_path):
    """A gate of two posts and a beam in one piece, 2 m wide; its convex hull has no opening."""
    import open3d as o3d

    make = o3d.geometry.TriangleMesh.create_box
    mesh = make(0.2, 2.0, 0.2).translate((-0.1, -1.0, 0.6))
    mesh += make(0.2, 0.2, 0.8).translate((-0.1, -1.0, 0.0))
    mesh += make(0.2, 0.2, 0.8).translate((-0.1, 0.8, 0.0))
    vertices = np.asarray(mesh.vertices)
    triangles = np.concatenate([np.asarray(mesh.triangles), [[0, 8, 16]]])  # one component
    joined = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(vertices), o3d.utility.Vector3iVector(triangles)
    )
    o3d.io.write_triangle_mesh(str(tmp_path / "arch.ply"), joined)


def test_an_error_inside_a_hollow_model_mentions_convexity(tmp_path):
    arch(tmp_path)
    text = EXAMPLE.replace(
        "[[moving_object]]", '[[model]]\nfile = "arch.ply"\nat = [1.2, 2.0]\n[[moving_object]]'
    )
    assert load(tmp_path, text).obstacles[-1].name == "arch 1"
    hollow = r"models are convex for contact: split a hollow one into convex pieces"
    with pytest.raises(InputError, match=rf"start .* is -0.10 m from 'arch 1'; .*{hollow}"):
        load(tmp_path, text.replace("start = [0.6, 2.0, 0]", "start = [1.2, 2.0, 0]"))
    with pytest.raises(InputError, match=rf"the line .* from 'arch 1'; .*{hollow}"):
        load(tmp_path, text.replace("from = [3.6, 1.0]\nto = [3.6", "from = [1.2, 1.5]\nto = [1.2"))


def test_a_model_below_the_floor_is_reported_with_the_needed_height(tmp_path):
    import open3d as o3d

    mesh = o3d.geometry.TriangleMesh.create_box(0.4, 0.4, 0.4).translate((-0.2, -0.2, -0.2))
    o3d.io.write_triangle_mesh(str(tmp_path / "cube.obj"), mesh)
    text = EXAMPLE + '[[model]]\nfile = "cube.obj"\nat = [1.5, 3.3]\nscale = 0.5\n'
    with pytest.raises(
        InputError, match=r"model\]\] 1: reaches 0.10 m below the floor; above = 0.1 "
    ):
        load(tmp_path, text)
    (cube,) = load(tmp_path, text + "above = 0.1\n").obstacles[-1].parts
    assert cube.bottom_m == pytest.approx(0.0, abs=1e-6)


def test_an_unreadable_model_is_reported_with_its_entry(tmp_path):
    text = EXAMPLE + '[[model]]\nname = "lamp"\nfile = "gone.obj"\nat = [1.5, 3.3]\n'
    with pytest.raises(InputError, match=r"mine.toml: \[\[model\]\] 1 'lamp': .*gone.obj: no such"):
        load(tmp_path, text)


def test_a_seed_below_zero_is_refused(tmp_path):
    with pytest.raises(InputError, match="seed -1 must not be negative"):
        load(tmp_path, EXAMPLE, -1)


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("item.stl", "not a mesh", "neither triangles nor points"),
        ("item.docx", "", "is not read"),
        ("item.urdf", "<robot><link name='a'><visual/></link></robot>", "no <geometry>"),
        ("item.urdf", "<robot", "not valid XML"),
    ],
)
def test_models_that_cannot_be_used_are_refused(tmp_path, name, content, said):
    (tmp_path / name).write_text(content)
    with pytest.raises(InputError, match=said):
        read_model(tmp_path / name)
    with pytest.raises(InputError, match="no such file"):
        read_model(tmp_path / "absent.obj")


def test_rotated_solids_keep_their_triangles():
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    turned = corners @ Rotation.from_euler("z", 30, degrees=True).as_matrix().T
    solid = Solid(turned, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]))
    assert distance(solid, np.array([[0.1, 0.2], [-1.0, 0.0]]))[0] < 0


def test_a_moving_object_may_have_a_law_of_its_own(tmp_path):
    (one,) = load(tmp_path, EXAMPLE + 'law = "curves"\n').moving_objects
    assert one.law == "curves"
    with pytest.raises(InputError, match=r"law = 'curvy'; expected one of to_and_fro, waypoints"):
        load(tmp_path, EXAMPLE + 'law = "curvy"\n')


TALL = Walker(breadth=2.0, top_m=1.3)
"""0.6 m wide."""


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("at = [0.6, 2.0]\nsize = [0.4, 0.4, 0.1]\nabove = 0.8", "start .* from 'bar'"),
        ("at = [2.5, 2.0]\nsize = [0.1, 4.0, 0.1]\nabove = 0.8", "goal 1 .* not reachable"),
        ("at = [1.0, 2.0]\nsize = [0.3, 0.3, 0.3]", "the robot needs 0.3 m"),
    ],
)
def test_a_scene_is_checked_for_the_robot_that_walks_in_it(entry, message, tmp_path):
    """Under a bar at 0.8 m a robot of 0.46 m stands and passes, one of 1.3 m does not; nor 0.25 m beside a box."""
    path = tmp_path / "mine.toml"
    head = "extent = [0, 0, 5, 4]\nstart = [0.6, 2.0, 0]\ngoals = [[4.4, 2.0]]\ntags = 0\n"
    path.write_text(f'{head}[[box]]\nname = "bar"\n{entry}\n')
    catalogue.load(str(path), 0)
    with pytest.raises(InputError, match=message):
        catalogue.load(str(path), 0, walker=TALL)
