#!/usr/bin/env bash
# Runs the test suite in environments of its own, .venv-NAME:
#   tests/versions.sh lowest PYTHON      the oldest versions that pyproject.toml allows
#   tests/versions.sh newest 3.12 3.13   the newest versions, on each of these Pythons that is found
# PYTEST_ARGS chooses the tests; all if unset.
set -euo pipefail
cd "$(dirname "$0")/.."
read -ra chosen <<< "${PYTEST_ARGS:--n 2 --dist loadfile}"

suite() {  # NAME PYTHON CONSTRAINTS
  local place=.venv-$1
  [ -d "$place" ] || "$2" -m venv "$place"
  "$place/bin/python" -m pip install --quiet --disable-pip-version-check --prefer-binary ${3:+-c "$3"} -e '.[dev]'
  echo "test suite: $1, $("$place/bin/python" -V)"
  NUMBA_CACHE_DIR=$PWD/$place/kernels "$place/bin/python" -m pytest -q "${chosen[@]}"
}

find_python() {  # VERSION: path of an interpreter that starts, or nothing
  local candidate
  for candidate in "$(command -v "python$1")" "${PYENV_ROOT:-$HOME/.pyenv}"/versions/"$1".*/bin/python; do
    if "$candidate" -c 'import venv, ensurepip' 2> /dev/null; then echo "$candidate"; return; fi
  done
}

kind=$1
shift
if [ "$kind" = lowest ]; then
  mkdir -p build
  "$1" tests/lowest.py > build/lowest.txt
  suite lowest "$1" build/lowest.txt
  exit
fi
tested=()
missing=()
for version in "$@"; do
  python=$(find_python "$version")
  if [ -z "$python" ]; then missing+=("$version"); continue; fi
  suite "$version" "$python" ""
  tested+=("$version")
done
echo "tested on Python: ${tested[*]:-none}"
if [ ${#missing[@]} -gt 0 ]; then echo "NOT TESTED, since not on this machine: Python ${missing[*]}" >&2; fi
[ ${#tested[@]} -gt 0 ]
