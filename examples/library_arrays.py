"""The library on NumPy arrays: each use in at most five lines. Lengths in m, angles in rad.

python -m examples.library_arrays
"""

import numpy as np

import surefoot as sf

CAMERA = sf.Camera(width=160, height=120, fx=146.0, fy=142.0, cx=79.5, cy=59.5)
HEIGHT_M = 0.9


def floor_of_a_depth_image():
    """A plane with covariance, or None."""
    depth_m = (
        depth_image()
    )  # (h, w) in m; of integers in mm: find_floor(..., scale_per_metre=1000.0)
    floor = sf.find_floor(depth_m, CAMERA)
    sigma_m = np.sqrt(floor.covariance[2, 2])
    print(f"the camera is {floor.offset_m:.3f} m +- {1000 * sigma_m:.1f} mm above the floor")
    return floor


def obstacles_of_a_depth_image():
    """Clusters on the floor below the camera: x where it looks, y left."""
    found = sf.find_obstacles(depth_image(), CAMERA)
    for obstacle in found:
        print(
            f"{obstacle.centre} m, radius {obstacle.radius_m:.2f}, height {obstacle.height_m:.2f}"
        )
    return found


def footprints_of_a_point_cloud():
    """Outlines on the floor, and the rectangle of a box."""
    points = np.mgrid[1.0:1.51:0.02, 0.0:0.31:0.02, 0.02:0.4:0.02].reshape(3, -1).T
    found = sf.find_footprints(points)  # (n, 3), z above the floor
    box = found[0].box
    print(f"{box.length_m:.2f} x {box.width_m:.2f} m about {box.centre}")
    return found


def depth_of_a_stereo_pair():
    """Depth, standard deviation and reliability of every pixel of the left image."""
    texture = np.random.default_rng(0).integers(0, 256, (120, 200), np.uint8)
    left, right = texture[:, :160], texture[:, 15:175]  # 15 px of disparity
    found = sf.stereo_depth(left, right, CAMERA, baseline_m=15 / 146)
    print(f"{np.nanmedian(found.depth_m):.3f} m +- {np.nanmedian(found.sigma_m):.3f} m")
    return np.nanmedian(found.depth_m)  # found.reliability: in [0, 1]


def where_to_look():
    """The best direction of the head, by the gaze map of seed 001."""
    obstacle, velocity, covariance = [[0.6, 0.8]], [[0.0, -0.2]], [0.04 * np.eye(2)]
    found = sf.gaze_map((1.0, 0.0), obstacle, velocity, covariance)  # waypoint; body frame
    print(f"pan {found.best.pan_rad:.2f}, tilt {found.best.tilt_rad:.2f} of {found.values.shape}")
    return found.best


def path_over_a_map():
    """Waypoints round the obstacles, or None."""
    occupied = np.zeros((60, 80))  # rows along y; NaN is unknown
    occupied[20:40, 40] = 1.0
    path = sf.find_path(occupied, cell_m=0.05, start=(0.5, 1.5), goal=(3.5, 1.5))
    print(f"{len(path)} waypoints: {path.round(2).tolist()}")
    return path


def track_of_detections():
    """Positions and velocities with covariances."""
    tracker = sf.Tracker()
    for k in range(20):
        tracks = tracker.update(0.3 * k, [[1.0 + 0.03 * k, 0.5]], 1e-4 * np.eye(2))
    print(f"velocity {tracks[0].velocity.round(3)} m/s, moving {tracks[0].moving:.2f}")
    return tracks[0]


def depth_image():
    """Depth of a floor 0.9 m below a level camera that looks 27 degrees down, an upright board on it 1.4 m ahead."""
    v, u = np.mgrid[0 : CAMERA.height, 0 : CAMERA.width]
    right, down = (u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy
    tilt = 0.47
    ahead, below = np.cos(tilt) - down * np.sin(tilt), np.sin(tilt) + down * np.cos(tilt)
    with np.errstate(divide="ignore"):
        depth, face = HEIGHT_M / below, 1.4 / ahead
    height = HEIGHT_M - face * below
    on_box = (np.abs(face * right) < 0.1) & (height > 0.0) & (height < 0.4)
    depth = np.where(on_box, np.minimum(depth, face), depth)
    depth += 0.002 * np.random.default_rng(1).normal(size=depth.shape)
    return np.where((depth > 0.0) & (depth < 4.0), depth, np.nan)


if __name__ == "__main__":
    floor_of_a_depth_image()
    obstacles_of_a_depth_image()
    footprints_of_a_point_cloud()
    depth_of_a_stereo_pair()
    where_to_look()
    path_over_a_map()
    track_of_detections()
