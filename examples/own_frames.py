"""The pipeline on frames of your own, one by one. Here they come from the recorded walk in data/walk.

python -m examples.own_frames
"""

import surefoot as sf
from surefoot.recordings.open import open_recording

WALK = "data/walk"  # or your own


def main(frames=40):
    recording = open_recording(WALK)
    known = (
        recording.info
    )  # of your robot: its start pose, and the tags on the walls if there are any
    pipeline = sf.Pipeline(landmarks=known.landmarks, start=known.start)
    for frame, _ in zip(recording.frames(), range(frames), strict=False):
        world = pipeline.add(
            frame.stamp_s,
            range_m=frame.tof.range_m,  # depth_m=... of an RGB-D camera; left=, right= of a stereo pair
            amplitude=frame.tof.amplitude,
            camera=frame.tof.camera,
            T_body_camera=frame.tof.T_body_camera,  # by the joint angles; z = 0 is the floor
            step=frame.odometry,  # motion since the frame before
            imu=frame.imu,
        )
        x, y, yaw = world.pose.mean
        print(f"{world.stamp_s:5.2f} s: {x:.3f} {y:.3f} {yaw:.3f}, {len(world.tracks)} tracks")
    print(f"{len(pipeline.footprints())} static obstacles")
    return world


if __name__ == "__main__":
    main()
