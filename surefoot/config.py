"""One configuration made of every part's own.

Works with no file at all; reads TOML, of which any part may be left out; a run writes the complete one
beside its results, and that file runs again to the same numbers.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from mapping.clouds import CloudConfig
