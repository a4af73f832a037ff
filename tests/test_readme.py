"""What README shows works as pasted."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import cv2
import numpy as np
import pytest

import surefoot
from surefoot.recordings.open import open_recording

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def block(language: str) -> str:
    """The first block of README in a language."""
    found = re.search(rf"```{language}\n(.*?)```", README, re.DOTALL)
    assert found is not None
    return found.group(1)


def floor_seen_from(height_m: float, tilt_rad: float, camera: surefoot.Camera) -> np.ndarray:
    """Depth of a level floor, m, float32; NaN above 4 m."""
    slope_y = (np.arange(camera.height) - camera.cy) / camera.fy
    down = np.cos(tilt_rad) * slope_y + np.sin(tilt_rad)
    with np.errstate(divide="ignore"):
        z = np.where(down > 0.0, height_m / down, np.nan)
    z[z > 4.0] = np.nan
    noise = np.random.default_rng(0).normal(0.0, 0.002, (camera.height, camera.width))
    return (z[:, None] + noise).astype(np.float32)


def test_readme_has_at_most_130_lines():
    assert len(README.splitlines()) <= 130


def test_the_library_example_finds_the_floor_within_its_standard_deviation(monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    camera = surefoot.Camera(640, 480, 525.0, 525.0, 319.5, 239.5)
    names = {"depth_m": floor_seen_from(0.8, 0.6, camera)}
    exec(compile(block("python"), "README.md", "exec"), names)
    floor = names["floor"]
    assert floor.offset_m == pytest.approx(0.8, abs=4.0 * np.sqrt(floor.covariance[2, 2]))
    up = np.array([0.0, -np.cos(0.6), -np.sin(0.6)])
    tilt_sigma = np.sqrt(np.trace(floor.covariance[:2, :2]))
    assert np.arccos(min(1.0, float(floor.normal @ up))) < 4.0 * tilt_sigma
    assert len(capsys.readouterr().out.splitlines()) >= 2


def test_the_recording_description_opens_a_folder_of_depth_images(tmp_path):
    tomllib.loads(block("toml"))
    (tmp_path / "recording.toml").write_text(block("toml"))
    (tmp_path / "depth").mkdir()
    for number in range(3):
        image = np.full((480, 640), 1500, np.uint16)
        cv2.imwrite(str(tmp_path / "depth" / f"{number:04d}.png"), image)
    frames = list(open_recording(tmp_path).frames())
    assert len(frames) == 3
    assert frames[0].depth is not None
    np.testing.assert_allclose(frames[0].depth.depth, 1.5)
