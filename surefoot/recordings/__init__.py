"""Recordings: frames that were seen before, or that others have seen.

Read `recording` (what every recording answers) and `open` (which reader a path needs). Then the readers:
`tum`, `seven_scenes`, `redwood` (Open3D's layout too), `replica` and `plain` for folders, `pcd` for one
organised cloud; they share `folder` (the lazy loop that skips and counts what is damaged), `images`,
`poses` and `description` (the `recording.toml` that says what a folder of images does not). Our own
recordings are MCAP: `codec` says what a recording can hold of a frame, `mcap_messages` how it is spelled
in Foxglove's schemas, `mcap_format` writes and reads the file, also one that a kill cut short.

Two readers are for self-localisation alone, logs without depth: `mrclam` (robots among landmarks) and `plaza`
(a mower among radio beacons).

Two rules hold everywhere. Depth scale and marks for "no depth" come from the format or from the recording,
never from a silent default. What is wrong with the recording as a whole is a `RecordingError`; what is
wrong with one frame skips that frame, with its reason kept.

Sources: the TUM RGB-D benchmark (Sturm et al., IROS 2012), 7-Scenes (Shotton et al., CVPR 2013), Redwood
(Choi et al., CVPR 2015), Replica as rendered for NICE-SLAM, PCD 0.7, MCAP and the Foxglove schemas.
"""
