"""The surface map against a known sphere and Open3D, and traversability against known ground."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mapping.surface.meshes import Mesh, load_mesh, save_mesh
from mapping.surface.surface_map import surface_map
from mapping.surface.traversability import (
    TraversabilityConfig,
    save_layers,
    save_nav2,
    traversability,
)
from mapping.surface.tsdf import Tsdf
from mapping.surface.tsdf_config import SurfaceMap, TsdfConfig
from perception.depth import structured_light
from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError, InputError
from perception.primitives.frame import Depth, DepthView
from perception.primitives.pose import Pose3

CAMERA = Camera(160, 120, 131.0, 131.0, 79.5, 59.5)
CENTRE, RADIUS = np.array([0.1, -0.05, 1.5]), 0.4


def sphere(pose: Pose3) -> Depth:
    directions = CAMERA.rays @ pose.rotation.T
    off = pose.position - CENTRE
    a = np.sum(directions**2, axis=-1)
    b = directions @ off
    inside = b * b - a * (off @ off - RADIUS**2)
    with np.errstate(invalid="ignore"):
        z = (-b - np.sqrt(inside)) / a
    return structured_light.depth(DepthView(z.astype(np.float32), CAMERA))


def views() -> list[Pose3]:
    return [Pose3((0.05 * n, 0.03 * n, 0.0)) for n in range(-2, 3)]


@pytest.mark.parametrize("method", ["compiled", "open3d"])
def test_a_sphere_is_found_to_a_few_millimetres(method: str) -> None:
    surface = surface_map(TsdfConfig(method=method))
    assert isinstance(surface, SurfaceMap)
    for pose in views() if method == "compiled" else views() * 2:
        surface.integrate(sphere(pose), pose)
    mesh = surface.mesh()
    points = mesh.sampled(5000, np.random.default_rng(0))
    errors = np.abs(np.linalg.norm(points - CENTRE, axis=1) - RADIUS)
    assert len(mesh.triangles) > 500
    assert np.median(errors) < 0.003


def test_triangles_and_normals_face_the_camera() -> None:
    surface = Tsdf()
    for pose in views():
        surface.integrate(sphere(pose), pose)
    mesh = surface.mesh()
    outward = (mesh.vertices - CENTRE) / np.linalg.norm(mesh.vertices - CENTRE, axis=1)[:, None]
    middle = mesh.vertices[:, 2] < CENTRE[2] - 0.5 * RADIUS
    assert np.all(np.sum(outward * mesh.normals, axis=1)[middle] > 0.8)
    a, b, c = (mesh.vertices[mesh.triangles[:, n]] for n in range(3))
    faces = np.cross(b - a, c - a)
    front = np.all(middle[mesh.triangles], axis=1)
    assert np.mean(np.sum(faces * outward[mesh.triangles[:, 0]], axis=1)[front] > 0.0) > 0.98


def test_the_surface_has_the_colours_of_the_image() -> None:
    surface = Tsdf()
    rgb = np.zeros((120, 160, 3), np.uint8)
    rgb[...] = (200, 100, 50)
    for pose in views():
        surface.integrate(sphere(pose), pose, rgb)
    colours = surface.mesh().colours
    assert colours is not None
    assert np.median(colours, axis=0) == pytest.approx((200, 100, 50), abs=3)


def flat(z_m: float, sigma_m: float, slope: float = 0.0) -> Depth:
    """A plane z = z_m + slope x before the camera, with the same standard deviation everywhere."""
    z = np.broadcast_to(z_m / (1.0 - slope * CAMERA.rays[..., 0]), (120, 160)).astype(np.float32)
    return Depth(z, np.full(z.shape, sigma_m, np.float32), CAMERA)


def fused_depth_m(*images: Depth) -> float:
    """Median depth of the surface near the optical axis after these images."""
    surface = Tsdf()
    for image in images:
        surface.integrate(image, Pose3())
    vertices = surface.mesh().vertices
    return float(np.median(vertices[np.abs(vertices[:, :2]).max(axis=1) < 0.2, 2]))


def test_depths_are_weighted_by_their_inverse_variance() -> None:
    """Deviations of 2 and 4 mm: weights 4 to 1; by inverse deviations it would be 2 to 1, 2.7 mm away."""
    assert fused_depth_m(flat(1.0, 0.002), flat(1.02, 0.004)) == pytest.approx(1.004, abs=0.001)


def test_a_slanted_plane_is_not_shifted_by_the_rounding_to_pixels() -> None:
    """At 45 deg half a pixel is 5 mm; each voxel takes the nearest pixel, so there is no shift."""
    surface = Tsdf()
    for _ in range(3):
        surface.integrate(flat(1.2, 0.002, slope=1.0), Pose3())
    x, y, z = surface.mesh().vertices.T
    inner = (np.abs(x) < 0.2) & (np.abs(y) < 0.2)
    assert np.mean(z[inner] - 1.2 - x[inner]) == pytest.approx(0.0, abs=0.0015)


def test_a_far_wall_beside_a_near_one_has_no_holes() -> None:
    z = np.full((120, 160), 0.5, np.float32)
    z[:, 48:64] = 4.5  # a gap through which a wall is seen; its rim is lost
    surface = Tsdf()
    surface.integrate(Depth(z, np.full_like(z, 0.005), CAMERA), Pose3())
    mesh = surface.mesh()
    far = mesh.vertices[mesh.triangles][..., 2].min(axis=1) > 4.4
    assert mesh.areas[far].sum() > 0.85 * 120 * 16 * (4.5 / 131.0) ** 2


def test_depth_without_noise_is_fused() -> None:
    surface, z = Tsdf(), np.full((120, 160), 1.5, np.float32)
    for _ in range(3):
        surface.integrate(Depth(z, np.zeros_like(z), CAMERA), Pose3())
    vertices = surface.mesh().vertices
    assert len(vertices) > 1000
    np.testing.assert_allclose(vertices[:, 2], 1.5, atol=1e-4)


def test_a_surface_that_moved_is_followed_however_often_the_old_one_was_seen() -> None:
    """The weight is limited to 1000; without the limit the surface would stay 12 mm from the new place."""
    many = [flat(1.0, 0.0002)] * 30  # weight 100 each
    assert fused_depth_m(*many, *[flat(1.02, 0.0002)] * 20) == pytest.approx(1.017, abs=0.002)


def test_seeing_a_surface_again_adds_no_blocks_and_storage_grows() -> None:
    surface = Tsdf(TsdfConfig(voxel_m=0.002, band_voxels=3.0))
    surface.integrate(sphere(Pose3()), Pose3())
    first = surface.blocks
    surface.integrate(sphere(Pose3()), Pose3())
    assert surface.blocks == first
    assert first > 1024  # the first capacity


def test_a_map_without_images_has_an_empty_surface() -> None:
    mesh = Tsdf().mesh()
    assert len(mesh.vertices) == len(mesh.triangles) == 0
    assert len(mesh.sampled(10, np.random.default_rng(0))) == 0
    assert traversability(mesh).height.size == 0


def test_unsuitable_images_and_settings_are_refused() -> None:
    with pytest.raises(InputError, match="register"):
        Tsdf().integrate(sphere(Pose3()), Pose3(), np.zeros((10, 10, 3), np.uint8))
    with pytest.raises(ConfigError, match="method"):
        TsdfConfig(method="octree")
    with pytest.raises(ConfigError, match="voxel_m"):
        TsdfConfig(voxel_m=-1.0)
    with pytest.raises(ConfigError, match="farthest_m"):
        TsdfConfig(farthest_m=0.1)


def test_a_saved_mesh_is_read_back_by_open3d(tmp_path: Path) -> None:
    open3d = pytest.importorskip("open3d")
    surface = Tsdf()
    surface.integrate(sphere(Pose3()), Pose3())
    mesh = surface.mesh()
    save_mesh(tmp_path / "sphere.ply", mesh)
    read = open3d.io.read_triangle_mesh(str(tmp_path / "sphere.ply"))
    assert np.asarray(read.vertices) == pytest.approx(mesh.vertices)
    assert np.array_equal(np.asarray(read.triangles), mesh.triangles)


def sheet(z: float, x: tuple[float, float], y: tuple[float, float]) -> Mesh:
    """A level sheet of small triangles."""
    xs, ys = np.arange(*x, 0.02), np.arange(*y, 0.02)
    grid = np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 2)
    vertices = np.column_stack([grid, np.full(len(grid), z)]).astype(np.float32)
    n = len(xs)
    corner = np.array([i * n + j for i in range(len(ys) - 1) for j in range(n - 1)], np.int32)
    triangles = np.concatenate(
        [
            np.stack([corner, corner + 1, corner + n], axis=1),
            np.stack([corner + 1, corner + n + 1, corner + n], axis=1),
        ]
    )
    return Mesh(vertices, triangles, np.tile(np.array([0, 0, 1], np.float32), (len(vertices), 1)))


def joined(*parts: Mesh) -> Mesh:
    first = np.cumsum([0, *(len(part.vertices) for part in parts)])
    return Mesh(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate(
            [part.triangles + int(n) for part, n in zip(parts, first, strict=False)]
        ).astype(np.int32),
        np.concatenate([part.normals for part in parts]),
    )


def test_a_box_on_a_floor_is_occupied_and_the_floor_is_free(tmp_path: Path) -> None:
    place = joined(sheet(0.0, (-1.0, 1.0), (-1.0, 1.0)), sheet(0.4, (0.0, 0.4), (-0.2, 0.2)))
    layers = traversability(place)
    centres = layers.centres
    box = (centres[..., 0] > 0.0) & (centres[..., 0] < 0.38) & (np.abs(centres[..., 1]) < 0.19)
    # the floor continues under this box, so its height shows it, and its edge is no foothold
    assert np.all(layers.height[box][5:-5] > 0.3)
    far = layers.known & (centres[..., 0] < -0.2)
    assert np.all(layers.probability[far] > 0.9)
    edge = box & (centres[..., 0] < 0.03)
    assert np.all(layers.probability[edge] < 0.01)
    assert save_nav2(tmp_path, "place", layers).is_file()
    save_layers(tmp_path / "place.npz", layers)
    with np.load(tmp_path / "place.npz") as read:
        assert np.array_equal(read["elevation"], layers.height, equal_nan=True)


def moved(part: Mesh, x: float, y: float) -> Mesh:
    return Mesh(part.vertices + np.float32([x, y, 0.0]), part.triangles, part.normals)


def test_a_floor_anywhere_is_mapped_where_it_is() -> None:
    floor = sheet(0.0, (-1.0, 1.0), (-1.0, 1.0))
    for x, y in ((70.0, 0.0), (-300.0, 4000.0)):
        layers = traversability(moved(floor, x, y))
        where = layers.centres[layers.known]
        assert np.allclose(where.mean(axis=0), (x - 0.01, y - 0.01), atol=0.03)
        assert layers.known.sum() * layers.cell_m**2 == pytest.approx(1.98**2, rel=0.05)
    long = joined(floor, moved(floor, 150.0, 0.0))  # of a corridor
    assert traversability(long).known.sum() == 2 * traversability(floor).known.sum()


def test_outskirts_too_far_for_the_memory_are_left_out_and_named(
    caplog: pytest.LogCaptureFixture,
) -> None:
    floor = sheet(0.0, (-1.0, 1.0), (-1.0, 1.0))
    crumb = moved(sheet(0.0, (0.0, 0.2), (0.0, 0.2)), 900.0, 900.0)
    layers = traversability(joined(floor, crumb))
    assert layers.height.shape == traversability(floor).height.shape
    share = len(crumb.triangles) / (len(crumb.triangles) + len(floor.triangles))
    assert f"{100 * share:.2g} % of it, further than 50 m" in caplog.text
    halves = joined(moved(floor, 0.0, 900.0), moved(floor, 900.0, 0.0))
    assert traversability(halves).known.any()  # their median lies on neither


def test_a_ramp_has_its_slope_and_surface_above_the_headroom_is_ignored() -> None:
    floor = sheet(0.0, (-0.5, 0.5), (-0.5, 0.5))
    ramp = Mesh(floor.vertices.copy(), floor.triangles, floor.normals)
    ramp.vertices[:, 2] = 0.2 * ramp.vertices[:, 0] + 0.15
    lamp = sheet(1.5, (-0.3, 0.3), (-0.3, 0.3))
    layers = traversability(joined(ramp, lamp), TraversabilityConfig(cell_m=0.04))
    inner = layers.slope[4:-4, 4:-4]
    assert np.nanmedian(inner) == pytest.approx(np.arctan(0.2), abs=0.02)
    assert np.nanmax(layers.height) < 0.7


def test_a_mesh_is_read_as_it_was_written_and_a_damaged_one_is_refused(tmp_path):
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
    triangles, path = np.array([[0, 1, 2], [0, 2, 3]], np.int32), tmp_path / "mesh.ply"
    up, tones = (
        np.broadcast_to(np.float32([0, 0, 1]), points.shape),
        np.arange(12, dtype=np.uint8).reshape(4, 3),
    )
    for colours in (tones, None):
        save_mesh(path, Mesh(points, triangles, up, colours))
        read = load_mesh(path)
        np.testing.assert_array_equal(read.vertices, points)
        np.testing.assert_array_equal(read.triangles, triangles)
        np.testing.assert_array_equal(read.normals, up)
        assert (read.colours is None) == (colours is None)
    content = path.read_bytes()
    beyond = content[:-4] + (9).to_bytes(4, "little")
    quads = content[:-26] + b"\x04" + content[-25:]
    nan = content.replace(points[1].tobytes(), np.full(3, np.nan, np.float32).tobytes(), 1)
    cases = {
        "cut off": content[:-1],
        "no triangle": beyond,
        "a face that is no": quads,
        "not within": nan,
        "no normals": content.replace(b"float nx", b"float a1", 1),
        "other than triangles": content.replace(b"uchar int vertex", b"float int vertex", 1),
        "is no PLY": b"OFF",
    }
    for words, damaged in cases.items():
        path.write_bytes(damaged)
        with pytest.raises(InputError, match=words):
            load_mesh(path)
