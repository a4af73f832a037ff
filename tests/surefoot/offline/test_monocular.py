"""The colour floor over recordings of every kind: robot's own, depth and colour, colour alone; and bad ones."""

from __future__ import annotations

import json
import math
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from perception.monocular.back_projection import camera_pose, floor_points
from perception.primitives.camera import Camera
from perception.primitives.errors import RecordingError
from perception.primitives.frame import ColourView, DepthView, Frame
from perception.primitives.pose import Pose2, Pose3, head_rotation
from planning.planners.swarm_planner import SwarmPlanner
from surefoot.cli.main import main
from surefoot.config.schema import Config
from surefoot.offline.job import Job
from surefoot.offline.monocular import UNUSABLE, colour_floors, run_monocular
from surefoot.recordings.open import open_recording
from surefoot.recordings.recording import RecordingInfo
from surefoot.results.moments import read_moments
from surefoot.results.run_folder import RunFolder
from surefoot.run.pipeline import Pipeline

CAMERA = Camera.from_view(320, 240, math.radians(75.0), math.radians(60.0))
WALK = Path(__file__).resolve().parents[3] / "data" / "walk"
WALL_M, EYE_M, STEP_M = 3.0, 0.5, 0.10
WORLDS = {
    "z up": np.eye(3),
    "y down": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),  # ICL-NUIM
    "y up": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]),  # Redwood
    "turned": head_rotation(0.7, 0.3),
}
"""The rotation from the upright world of the scene to that of the recording."""


def quiet(text):
    pass


class Scene:
    """A camera that goes ahead over a wooden floor, to a blue wall with a box before it."""

    def __init__(self, world="z up", depth=True, poses=True, up=True, height=True, frames=4):
        R = WORLDS[world]
        self.info = RecordingInfo(
            "scene",
            "plain",
            poses_given=poses,
            frames=frames,
            gravity_up_world=tuple((R @ [0.0, 0.0, 1.0]).tolist()) if up else None,
            floor_height_world_m=0.25 if height else None,
        )
        self.skipped, self.remarks, self.parts = [], [], []
        rng = np.random.default_rng(3)
        shift = Pose3.from_rotation(R, R @ np.array([0.3, -0.2, 0.25]))
        for k in range(frames):
            place = np.array([STEP_M * k, 0.0, EYE_M])
            pose = camera_pose(place, 0.4, math.radians(30.0), 0.0)
            ahead = pose.position + k * STEP_M * np.array([math.cos(0.4), math.sin(0.4), 0.0])
            pose = Pose3.from_rotation(pose.rotation, ahead - place + np.array([0.0, 0.0, EYE_M]))
            z, rgb = self._seen(pose, rng)
            self.parts.append(
                Frame(
                    0.2 * k,
                    depth=DepthView(z, CAMERA) if depth else None,
                    colour=ColourView(rgb, CAMERA),
                    T_world_camera=shift @ pose if poses else None,
                )
            )

    @staticmethod
    def _seen(pose, rng):
        """Depth and colour by casting rays at the floor, the wall and the front of the box."""
        rays = CAMERA.rays @ pose.rotation.T
        c, s = math.cos(0.4), math.sin(0.4)
        out, side = rays @ [c, s, 0.0], rays @ [-s, c, 0.0]
        gone, aside = pose.position @ [c, s, 0.0], pose.position @ [-s, c, 0.0]
        with np.errstate(divide="ignore"):
            floor = np.where(rays[..., 2] < 0.0, -pose.position[2] / rays[..., 2], np.inf)
            wall = np.where(out > 0.0, (WALL_M - gone) / out, np.inf)
            box = np.where(out > 0.0, (1.6 - gone) / out, np.inf)
        up = pose.position[2] + box * rays[..., 2]
        hit = (np.abs(aside + box * side - 0.3) < 0.2) & (up > 0.0) & (up < 0.3)
        box = np.where(hit, box, np.inf)
        z = np.minimum(np.minimum(floor, wall), box)
        tone = np.where((floor <= z)[..., None], (190, 150, 105), (110, 140, 180)).astype(float)
        tone[box <= z] = (60, 160, 70)
        tone += rng.normal(0.0, 3.0, tone.shape)
        return z.astype(np.float32), np.clip(tone, 0, 255).astype(np.uint8)

    def frames(self):
        yield from self.parts


def job(scene, out):
    return Job.of("monocular", scene, Config(), out)


def path_of(floors):
    """Position of each picture relative to the first one: ahead along its axis, and to the left, m."""
    first = floors[0].result.current.T_world_camera
    ahead = first.rotation[:2, 2] / np.linalg.norm(first.rotation[:2, 2])
    left = np.array([-ahead[1], ahead[0]])
    moved = [f.result.current.T_world_camera.position[:2] - first.position[:2] for f in floors]
    return np.array([[m @ ahead, m @ left] for m in moved])


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("up", [True, False], ids=["gravity known", "by the first floor"])
def test_a_step_ahead_is_a_step_on_the_floor_for_any_world_axes(world, up):
    floors = list(colour_floors(Scene(world, up=up)))
    assert len(floors) == 4
    expected = [[STEP_M * k, 0.0] for k in range(4)]
    np.testing.assert_allclose(path_of(floors), expected, atol=0.01)
    for floor in floors:
        pose = floor.result.current.T_world_camera
        assert pose.position[2] == pytest.approx(EYE_M, abs=0.01)
        assert -pose.rotation[2, 2] == pytest.approx(math.sin(math.radians(30.0)), abs=0.01)
        assert abs(pose.rotation[2, 0]) < 0.01
        assert floor.iou > 0.95
    assert all(f.result.previous is not None for f in floors[1:])


@pytest.mark.parametrize("world", WORLDS)
def test_static_obstacles_have_no_velocity_while_the_camera_moves(world):
    floors = list(colour_floors(Scene(world)))
    flows = np.concatenate([f.result.flows.velocity_world for f in floors[1:]])
    assert np.nanmedian(np.hypot(*flows.T)) < 0.1  # the camera itself goes 0.5 m/s


def test_without_poses_the_floor_in_depth_gives_the_camera_pose():
    floors = list(colour_floors(Scene(poses=False, up=False, height=False)))
    assert len(floors) == 4
    for floor in floors:
        assert floor.result.current.T_world_camera.position[2] == pytest.approx(EYE_M, abs=0.01)
        assert floor.iou > 0.95


@pytest.mark.parametrize("world", WORLDS)
def test_colour_with_poses_and_without_depth_is_processed_but_not_compared(world, tmp_path):
    scene = Scene(world, depth=False)
    floors = list(colour_floors(scene))
    assert [f.iou for f in floors] == [None] * 4
    np.testing.assert_allclose(path_of(floors), [[STEP_M * k, 0.0] for k in range(4)], atol=1e-6)
    for floor, frame in zip(floors, Scene().parts, strict=True):
        assert floor.result.current.T_world_camera.position[2] == pytest.approx(EYE_M)
        z = frame.depth.depth
        v = np.mgrid[0:240, 0:320][0]
        points = CAMERA.rays * z[..., None]
        height = floor.result.current.T_world_camera.apply(points)[..., 2]
        floor_seen = (np.abs(height) < 1e-3) & (v > 0)
        ground = floor.result.ground > 0
        assert np.sum(ground & floor_seen) / np.sum(ground | floor_seen) > 0.97
    content = run_monocular(job(scene, tmp_path / "run"), quiet)
    assert content["frames"] == 4
    assert content["judged"] == 0
    assert "iou" not in content


def test_every_frame_gives_a_picture_of_its_stages_and_the_summary_the_iou(tmp_path, pages):
    with pages():
        content = run_monocular(job(Scene(), tmp_path / "run"), quiet)
    names = [p.name for p in sorted((tmp_path / "run").glob("stages-*.png"))]
    assert names == [f"stages-{k:06d}.png" for k in range(4)]
    assert cv2.imread(str(tmp_path / "run" / names[0])) is not None
    assert (content["frames"], content["judged"], content["skipped"]) == (4, 4, {})
    assert 0.95 < content["iou_min"] <= content["iou"] <= 1.0
    heights = [
        one.cameras["colour"].position[2] for one in read_moments(RunFolder(tmp_path / "run"))
    ]
    assert heights == pytest.approx(
        [EYE_M] * 4, abs=0.02
    )  # the stream has the camera over the floor
    assert "frame 3: " in (tmp_path / "run" / "replay.html").read_text()
    assert json.loads((tmp_path / "run" / "monocular.json").read_text()) == content


def faulty(frame, kind):
    """A frame with a wrong picture size, an invalid pose, or a black picture."""
    if kind == "size":
        return replace(frame, colour=ColourView(frame.colour.rgb[:100], CAMERA))
    if kind == "pose":
        nowhere = Pose3((math.nan, 0.0, 0.0), frame.T_world_camera.quat_xyzw)
        return replace(frame, T_world_camera=nowhere)
    return replace(frame, colour=ColourView(np.zeros((240, 320, 3), np.uint8), CAMERA))


@pytest.mark.parametrize("depth", [True, False])
@pytest.mark.parametrize("kind", ["size", "pose"])
def test_an_unusable_frame_is_skipped_and_counted(kind, depth, tmp_path):
    scene = Scene(depth=depth)
    scene.parts[1] = faulty(scene.parts[1], kind)
    content = run_monocular(job(scene, tmp_path / "run"), quiet)
    assert content["frames"] == 3
    assert content["skipped"] == {UNUSABLE: 1}


def test_a_black_picture_shows_no_floor_and_does_not_affect_the_next():
    scene = Scene()
    scene.parts[1] = faulty(scene.parts[1], "black")
    floors = list(colour_floors(scene))
    assert not floors[1].result.ground.any()
    assert floors[2].iou > 0.95


@pytest.mark.parametrize("depth", [True, False])
def test_without_a_single_frame_over_a_floor_it_fails_and_says_why(depth, tmp_path):
    scene = Scene(depth=depth, poses=False)
    scene.parts = [replace(f, colour=None) for f in scene.parts]
    with pytest.raises(RecordingError, match=r"none of its frames.*4: it has no colour picture"):
        run_monocular(job(scene, tmp_path / "run"), quiet)
    assert not (tmp_path / "run" / "monocular.json").exists()


def test_colour_without_depth_needs_the_height_of_the_floor(tmp_path):
    with pytest.raises(RecordingError, match=r"4: .*floor_height"):
        run_monocular(job(Scene(depth=False, height=False), tmp_path / "run"), quiet)
    with pytest.raises(RecordingError, match="4: no floor is seen in it, and it has no pose"):
        run_monocular(job(Scene(depth=False, poses=False), tmp_path / "run"), quiet)


def call(*words):
    result = CliRunner().invoke(main, [str(word) for word in words])
    return result.exit_code, result.output


def test_a_recorded_walk_is_processed_with_the_estimated_pose_of_the_body(tmp_path):
    out = tmp_path / "out"
    code, shown = call("monocular", WALK, "--out", out, "--json")
    assert code == 0
    content = json.loads(shown[shown.index("{") :])
    pictures = sum(frame.colour is not None for frame in open_recording(WALK).frames())
    assert content["frames"] == pictures > 10
    assert content["judged"] == 0
    truth = np.loadtxt(WALK / "truth" / "trajectory.txt")
    for floor in colour_floors(open_recording(WALK)):
        current = floor.result.current
        true = truth[np.argmin(np.abs(truth[:, 0] - current.stamp_s))]
        assert np.hypot(*(current.T_world_camera.position[:2] - true[1:3])) < 0.15
        assert 0.3 < current.T_world_camera.position[2] < 0.45


def test_the_folder_of_the_recording_is_refused_as_output(tmp_path):
    copy = tmp_path / "walk"
    shutil.copytree(WALK, copy)
    (copy / ".surefoot-run").write_text("1\n")
    before = (copy / "recording.mcap").read_bytes()
    code, shown = call("monocular", copy, "--out", copy)
    assert code != 0
    assert "holds the recording that is read" in shown
    assert (copy / "recording.mcap").read_bytes() == before


def test_settings_reach_the_cycle_and_bad_ones_are_refused_in_words(tmp_path):
    code, shown = call(
        "monocular", WALK, "--out", tmp_path / "o", "--set", "monocular.farthest_m=0"
    )
    assert code == 2
    assert "farthest_m=0.0 must be positive and finite" in shown
    short = replace(Config().monocular, farthest_m=1.0)
    near = list(colour_floors(Scene(), replace(Config(), monocular=short)))
    contacts = np.concatenate([o.contact_world for f in near for o in f.result.obstacles])
    assert np.isnan(contacts).all()  # box and wall lie farther than a metre


def test_a_recording_without_pictures_ends_with_an_exit_code(tmp_path):
    folder = tmp_path / "depth only"
    (folder / "depth").mkdir(parents=True)
    cv2.imwrite(str(folder / "depth" / "000000.png"), np.full((48, 64), 1000, np.uint16))
    (tmp_path / "recording.toml").write_text(
        "[camera]\nwidth = 64\nheight = 48\nfx = 60.0\nfy = 60.0\ncx = 31.5\ncy = 23.5\n"
        "[depth]\nscale_per_metre = 1000.0\nnone = [0]\n"
    )
    code, shown = call(
        "monocular", folder, "--description", tmp_path / "recording.toml", "--out", tmp_path / "o"
    )
    assert code == 2
    assert "none of its frames could be used" in shown


@pytest.mark.parametrize("kind", ["ceiling", "black"])
def test_the_swarm_planner_stops_at_pictures_without_a_floor(kind):
    tilt = -1.2 if kind == "ceiling" else math.radians(30.0)
    head = Pose3.from_rotation(head_rotation(0.0, tilt), np.array([0.05, 0.0, 0.383]))
    rng = np.random.default_rng(1)
    shade = 0 if kind == "black" else 150
    rgb = np.clip(rng.normal(shade, 2.0, (240, 320, 3)), 0, 9 if kind == "black" else 255)
    config = replace(Config(), scene="robots_room")
    config = replace(config, monocular=replace(config.monocular, use="always"))
    planner = SwarmPlanner(config.planning, [(2.0, 0.0)])
    pipeline = Pipeline(config, RecordingInfo("live", "simulation", start=Pose2()))
    for k in range(3):
        frame = Frame(
            0.65 * k,
            colour=ColourView(rgb.astype(np.uint8), CAMERA, head),
            footstep_due=True,
        )
        world = pipeline.cycle(frame)
        planner.observe(world)
        assert planner.decide(world).walk.forward_m == 0.0  # no pixel to walk to
        seen = world.colour_floor
        assert seen is None if kind == "black" else not seen.result.movable.any()


def test_floor_points_of_the_pictures_lie_where_the_scene_has_them():
    """The foot of the box, 1.6 m ahead and 0.1 to 0.5 m to the left, wherever the camera has got to."""
    floors = list(colour_floors(Scene("y down")))
    assert len(floors) > 2
    for floor in floors:
        current = floor.result.current
        pose = current.T_world_camera
        ahead = pose.rotation[:2, 2] / np.linalg.norm(pose.rotation[:2, 2])
        green = current.rgb.astype(int)
        box = green[..., 1] - green[..., 0] > 60
        feet = np.array(
            [[u, np.flatnonzero(box[:, u])[-1] + 0.5] for u in np.flatnonzero(box.any(0))]
        )
        points = floor_points(feet, CAMERA, pose) - pose.position[:2]
        expected = 1.6 - STEP_M * floor.number
        assert np.median(points @ ahead) == pytest.approx(expected, abs=0.03)
