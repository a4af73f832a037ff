"""calibrate-noise writes settings that the other verbs take, and says what a recording does not tell."""

from __future__ import annotations

import json
import tomllib

import cv2
import numpy as np
import pytest
from click.testing import CliRunner
from scipy.spatial.transform import Rotation

from perception.primitives.frame import Frame, StereoView
from surefoot.cli.main import main
from surefoot.config.load import load
from surefoot.config.schema import Config
from surefoot.offline.calibrate_noise import calibrate
from surefoot.recordings.recording import RecordingInfo

from ...perception.odometry import road
from ...perception.odometry.bent_room import BENT, IMAGES, pose, seen

CAMERA = "[camera]\nwidth = 160\nheight = 120\nfx = 140.0\nfy = 140.0\ncx = 79.5\ncy = 59.5\n"
DEPTH = "[depth]\nscale_per_metre = 10000\nnone = [0]\n"
TURNED = np.radians(0.1)
SHARE = 2.0  # of the published noise


def call(*words):
    """Exit code and output of the program."""
    result = CliRunner().invoke(main, [str(word) for word in words])
    return result.exit_code, result.output


@pytest.fixture(scope="module")
def bare_floor(tmp_path_factory):
    """A recording of a bare floor from 0.6 to 1.5 m, with twice the published noise and no bend."""
    folder = tmp_path_factory.mktemp("floor")
    (folder / "depth").mkdir()
    rng = np.random.default_rng(0)
    v = np.mgrid[0:120, 0:160][0]
    for number in range(8):
        height, pitch = 0.6 + 0.13 * number, np.radians(35.0 + 4.0 * number)
        down = (v - 59.5) / 140.0 * np.cos(pitch) + np.sin(pitch)
        z = np.where(down > 0.05, height / np.maximum(down, 0.05), np.inf)
        z = z + SHARE * (0.0012 + 0.0019 * (z - 0.4) ** 2) * rng.normal(size=z.shape)
        units = np.where(np.isfinite(z) & (z < 4.0), 1e4 * z, 0.0)
        cv2.imwrite(str(folder / "depth" / f"{number:06d}.png"), np.rint(units).astype(np.uint16))
    (folder / "recording.toml").write_text("rate_hz = 30.0\n" + CAMERA + DEPTH)
    return folder


def test_the_file_has_the_noise_of_the_sensor_and_every_verb_takes_it(bare_floor, tmp_path):
    out = tmp_path / "sensor.toml"
    code, shown = call("calibrate-noise", bare_floor, "--out", out, "--json")
    assert code == 0, shown
    content = json.loads(shown[shown.index("{") :])
    assert content["sensor"] == "depth"
    assert content["views"] == 8
    noise = tomllib.loads(out.read_text())["structured_light"]
    assert noise["growth_per_m"] == pytest.approx(SHARE * 0.0019, rel=0.1)
    assert noise["floor_m"] == pytest.approx(SHARE * 0.0012, rel=0.25)
    config = load(out)
    assert config.structured_light.growth_per_m == noise["growth_per_m"]
    assert config.floor.distortion.depth.share < 0.7 * load(None).floor.distortion.depth.share
    assert config.floor_of(True) == config.floor  # what the user measured holds for a robot too
    code, shown = call("process", bare_floor, "--config", out, "--out", tmp_path / "run")
    assert code == 0, shown


def test_what_the_recording_does_not_tell_is_said(bare_floor, tmp_path):
    code, shown = call("calibrate-noise", bare_floor, "--out", tmp_path / "sensor.toml")
    assert code == 0
    assert "scale and tilt not told" in shown
    assert "±" in shown
    assert "+-" not in shown


def test_noise_at_one_distance_scales_the_model(tmp_path):
    """A wall 1.2 m ahead, with four times the published noise there."""
    folder = tmp_path / "wall"
    (folder / "depth").mkdir(parents=True)
    rng = np.random.default_rng(0)
    for number in range(4):
        z = 1.2 + 4.0 * (0.0012 + 0.0019 * 0.8**2) * rng.normal(size=(120, 160))
        cv2.imwrite(str(folder / "depth" / f"{number:06d}.png"), np.rint(1e4 * z).astype(np.uint16))
    (folder / "recording.toml").write_text("rate_hz = 30.0\n" + CAMERA + DEPTH)
    code, shown = call("calibrate-noise", folder, "--out", tmp_path / "sensor.toml")
    assert code == 0, shown
    assert "growth of noise not told" in shown
    noise = tomllib.loads((tmp_path / "sensor.toml").read_text())["structured_light"]
    assert noise["floor_m"] == pytest.approx(4.0 * 0.0012, rel=0.1)
    assert noise["growth_per_m"] == pytest.approx(4.0 * 0.0019, rel=0.1)


def test_an_existing_file_is_not_overwritten(bare_floor, tmp_path):
    out = tmp_path / "sensor.toml"
    out.write_text("seed = 1\n")
    code, shown = call("calibrate-noise", bare_floor, "--out", out)
    assert code != 0
    assert "exists; choose another file with --out" in shown
    assert out.read_text() == "seed = 1\n"


def test_a_recording_without_flat_surfaces_is_refused_with_advice(tmp_path):
    folder = tmp_path / "clutter"
    (folder / "depth").mkdir(parents=True)
    units = np.random.default_rng(0).integers(5000, 30000, (120, 160)).astype(np.uint16)
    cv2.imwrite(str(folder / "depth" / "000000.png"), units)
    (folder / "recording.toml").write_text("rate_hz = 30.0\n" + CAMERA + DEPTH)
    code, shown = call("calibrate-noise", folder, "--out", tmp_path / "sensor.toml")
    assert code != 0
    assert "no flat surface" in shown
    assert "record a bare floor or a wall" in shown
    assert not (tmp_path / "sensor.toml").exists()


@pytest.fixture(scope="module")
def bent_recording(tmp_path_factory):
    """36 images of a room with their poses."""
    folder = tmp_path_factory.mktemp("bent") / "room"
    rng = np.random.default_rng(2)
    for part in ("depth", "rgb"):
        (folder / part).mkdir(parents=True)
    lines = []
    for number in range(IMAGES):
        T = pose(number)
        z, rgb = seen(T, BENT, rng)
        cv2.imwrite(
            str(folder / "depth" / f"{number:06d}.png"), np.rint(5000.0 * z).astype(np.uint16)
        )
        cv2.imwrite(str(folder / "rgb" / f"{number:06d}.png"), rgb)
        quaternion = Rotation.from_matrix(T.rotation).as_quat()
        lines.append(" ".join(f"{v:.6f}" for v in (number / 30.0, *T.position, *quaternion)))
    (folder / "truth.txt").write_text("\n".join(lines) + "\n")
    (folder / "recording.toml").write_text(
        "rate_hz = 30.0\n[camera]\nwidth = 160\nheight = 120\nfx = 140.0\nfy = 140.0\ncx = 79.5\ncy = 59.5\n"
        '[depth]\nfolder = "depth"\nscale_per_metre = 5000\nnone = [0]\n[colour]\nfolder = "rgb"\n'
    )
    return folder


def largest_error_m(run, truth) -> float:
    """Largest distance of the camera from its true place, both relative to the first pose."""
    found, true = np.loadtxt(run / "trajectory.txt"), np.loadtxt(truth)
    errors = []
    for a, b in zip(found, true, strict=True):
        moved = [
            Rotation.from_quat(first[4:]).inv().apply(last[1:4] - first[1:4])
            for first, last in ((found[0], a), (true[0], b))
        ]
        errors.append(np.linalg.norm(moved[0] - moved[1]))
    return float(np.max(errors))


def test_calibrated_settings_straighten_a_trajectory(bent_recording, tmp_path):
    settings = tmp_path / "camera.toml"
    code, said = call("calibrate-noise", bent_recording, "--out", settings)
    assert code == 0, said
    assert "motions of the camera" in said
    written = load(settings).structured_light.bend.coefficients
    np.testing.assert_allclose(written, BENT.coefficients, atol=0.004)
    errors = []
    for name, more in (("as_is", []), ("straight", ["--config", settings])):
        out = tmp_path / name
        code, said = call("process", bent_recording, "--out", out, *more)
        assert code == 0, said
        assert ("depth bends by at least" in said) == (not more)
        errors.append(largest_error_m(out, bent_recording / "truth.txt"))
    assert errors[1] < 0.5 * errors[0]
    again = tmp_path / "again.toml"  # with the bend taken out already, it stays in the file
    code, said = call("calibrate-noise", bent_recording, "--config", settings, "--out", again)
    assert code == 0, said
    written = load(again).structured_light.bend.coefficients
    np.testing.assert_allclose(written, BENT.coefficients, atol=0.004)


class Drive:
    """Images of a road by a pair whose right camera is turned; nothing flat is near enough to tell the noise."""

    info = RecordingInfo("drive", "stereo", frames=30)
    skipped = ()
    remarks = ()

    def __init__(self):
        rng = np.random.default_rng(7)
        self.seen = [road.seen(road.pose(n), TURNED, rng) for n in range(30)]

    def frames(self):
        for number, (_, rgb) in enumerate(self.seen):
            left = rgb[..., 0].copy()
            left[0, 0] = number
            yield Frame(0.1 * number, stereo=StereoView(left, left, road.BASELINE_M, road.CAMERA))


def test_a_pair_that_drove_gets_its_vergence_also_without_flat_surfaces(monkeypatch, tmp_path):
    drive = Drive()
    monkeypatch.setattr(
        "perception.depth.sources.stereo.depth",
        lambda view, config: drive.seen[view.left[0, 0]][0],
    )
    found = calibrate(drive, Config(), lambda _: None)
    found.write(tmp_path / "pair.toml")
    config = load(tmp_path / "pair.toml")
    assert config.stereo.vergence_deg == pytest.approx(np.degrees(TURNED), abs=0.06)
    assert abs(config.stereo.vergence_deg - np.degrees(TURNED)) < 3.0 * np.degrees(
        found.vergence.sigma
    )
    assert any("outwards by +0." in line for line in found.lines())
    assert found.content()["vergence_deg"] == pytest.approx(config.stereo.vergence_deg, abs=1e-5)
