"""A Parquet file that cannot be written is an error of the system, with its number."""

import errno

import numpy as np
import pytest

from surefoot.store import parquet


def test_a_full_disk_is_an_error_of_the_system(tmp_path):
    path = tmp_path / "a.parquet"
    path.symlink_to("/dev/full")
    with pytest.raises(OSError, match=str(path)) as caught:
        parquet.copy(parquet.connect(1), {"x": np.arange(3)}, path)
    assert caught.value.errno == errno.ENOSPC
