"""A depth source of your own: a time-of-flight camera whose weak returns are left out.

    surefoot process data/walk --set 'depth_sources=["examples.my_depth_source:strong_returns"]'

The list replaces "tof", "depth" and "stereo", ours; name those too that shall stay. A source may use anything in the
frame, such as the stereo pair with a matcher of your own, or the colour image with a network.
"""

import numpy as np

from surefoot import Depth

LEAST_AMPLITUDE = 0.01  # of the strongest return


def strong_returns(
    frame,
):  # surefoot.Frame -> surefoot.Depth, or None if the frame has nothing to use
    tof = frame.tof
    if tof is None:
        return None
    along_axis = tof.range_m / np.linalg.norm(tof.camera.rays, axis=-1)  # range along the ray to z
    z = along_axis.astype(np.float32)
    if tof.amplitude is not None:
        z[tof.amplitude < LEAST_AMPLITUDE * np.nanmax(tof.amplitude)] = np.nan  # NaN: no depth
    sigma = (0.004 + 0.004 * z**2).astype(np.float32)  # standard deviation of z, m
    return Depth(z, sigma, tof.camera, tof.T_body_camera)
