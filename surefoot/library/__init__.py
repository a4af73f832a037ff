"""The public library: what `import surefoot` gives.

Functions on NumPy arrays, one subject a module (`floor`, `obstacles`, `stereo`, `gaze`, `path`), objects that live
from frame to frame (`tracker`, `pipeline`), and the verbs of the command line (`verbs`) with what they return
(`run_results`). `checks` refuses unusable input. A program imports these names from `surefoot`, not from here.
"""
