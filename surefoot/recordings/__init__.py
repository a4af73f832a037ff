"""Readers of recordings, and the writer of our own format.

Read `recording` (the protocol) and `open` (choice of the reader) first. The readers of folders are `tum`,
`icl_nuim`, `seven_scenes`, `scannet`, `redwood` (also Open3D's layout), `replica`, `stray_scanner`, `euroc` and
`plain`; `pcd` reads one organised point cloud. They share `folder` (the loop that reads one frame at a time and skips
damaged ones), `images`, `poses` and `description` (recording.toml, which describes a plain folder of images). `rosbag`
reads ROS bags, with `ros_messages` and `ros_transforms`. Our own recordings are MCAP files: `codec` encodes a frame,
`mcap_messages` maps it to Foxglove schemas, `mcap_format` writes and reads the file, even a truncated one.

`mrclam` (robots among landmarks) and `plaza` (a mower among radio beacons) read logs without depth, for
localisation only; `robot_log` gives both the same form.

Two rules hold for all readers. Depth scale and values without depth come from the format or the recording, never
from a silent default. An error of the whole recording raises a `RecordingError`; an error of one frame skips
that frame and records the reason.

Sources: the TUM RGB-D benchmark (Sturm et al., IROS 2012), 7-Scenes (Shotton et al., CVPR 2013), Redwood
(Choi et al., CVPR 2015), Replica as rendered for NICE-SLAM, PCD 0.7, MCAP and the Foxglove schemas.
"""
