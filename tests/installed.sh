#!/usr/bin/env bash
# Tests what only an installed wheel can show: the metadata, another working folder, a package of the same name in the
# way, no home, read-only site-packages, no PyBullet.
#   PYTHON   the interpreter of the fresh environment; that of .venv if unset
#   LEND     a site-packages folder whose dependencies are used instead of installing them
set -euo pipefail
here=$(cd "$(dirname "$0")/.." && pwd)
python=${PYTHON:-$here/.venv/bin/python}
work=$(mktemp -d)
chmod 755 "$work"
trap 'chmod -R u+w "$work"; rm -rf "$work"' EXIT
export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 NUMBA_THREADING_LAYER=workqueue PIP_DISABLE_PIP_VERSION_CHECK=1
unset PYTHONPATH NUMBA_CACHE_DIR XDG_CACHE_HOME
fail() {  # MESSAGE [LOG]
  if [ $# -gt 1 ]; then cat "$2" >&2; fi
  echo "installed: $1" >&2
  exit 1
}

echo "the wheel in a fresh environment"
"$python" -m pip wheel --quiet --no-deps -w "$work" "$here"
"$python" -m venv "$work/env"
bin=$work/env/bin
site=$("$bin/python" -c 'import sysconfig; print(sysconfig.get_path("purelib"))')
if [ -n "${LEND:-}" ]; then
  echo "$LEND" > "$site/lent.pth"  # .pth files in there, such as that of an editable install, are not read
  "$bin/python" -m pip install --quiet --no-deps --no-index "$work"/surefoot-*.whl
else
  lock=$("$bin/python" -c 'import sys; print("-c requirements.lock" * (sys.version_info[:2] == (3, 11)))')
  # shellcheck disable=SC2086  # two words or none
  (cd "$here" && "$bin/python" -m pip install --quiet $lock "$work"/surefoot-*.whl)
  "$bin/python" -m pip check
fi
mkdir "$work/away" && cd "$work/away"
case $("$bin/python" -c 'import surefoot; print(surefoot.__file__)') in
  "$site"/*) ;;
  *) fail "the wheel is not what is imported" ;;
esac

echo "read-only, without a home, with an own planning/ here: simulate, process, evaluate"
mkdir planning && touch planning/__init__.py
mkdir "$work/tmp" "$work/locked"
chmod -R a-w "$site"
chmod a-w "$work/locked"
powerless=()  # root may write everywhere unless it gives up its capabilities
if [ "$(id -u)" = 0 ]; then powerless=(setpriv --bounding-set=-all --inh-caps=-all --no-new-privs); fi
alone() { "${powerless[@]}" env HOME="$work/locked/home" TMPDIR="$work/tmp" "$@"; }
code=0
alone "$bin/surefoot" simulate home --seed 0 --record --set mission.time_limit_s=3 --out live 2> log || code=$?
[ "$code" -le 1 ] && [ -s live/summary.json ] || fail "simulate" log  # 1: no goal is reached in 3 s
grep -q "compiling kernels" log || fail "the first compilation was not announced" log
[ -z "$(find "$site" -name '*.nb[ic]')" ] || fail "compiled code was written into a read-only installation"
[ -n "$(find "$work/tmp" -name '*.nbi')" ] || fail "compiled code was not kept"
alone "$bin/surefoot" process live --out again 2> log || fail "process" log
! grep -q "compiling kernels" log || fail "kernels were compiled twice" log
alone "$bin/surefoot" evaluate again > log 2>&1 || fail "evaluate" log
cmp live/trajectory_covariance.csv again/trajectory_covariance.csv
cmp live/map.pgm again/map.pgm
[ -s again/report.html ] || fail "evaluate wrote no report"
alone "$bin/surefoot" quickstart --out first > log 2>&1 || fail "quickstart" log
[ -s first/report.html ] || fail "quickstart wrote no page" log
alone "$bin/surefoot" doctor > log || fail "doctor" log
! grep -q "make \|requirements.lock" log || fail "doctor's advice is for a checkout" log

echo "a package of the same name is named in one line"
if alone "$bin/python" -m surefoot process live --out never 2> log; then fail "a foreign package was used"; fi
[ "$(wc -l < log)" = 1 ] && grep -q "planning hides surefoot's package" log || fail "python -m surefoot" log
echo "import surefoot.config" > mine.py
if alone "$bin/python" mine.py 2> log; then fail "a foreign package was used"; fi
tail -n 1 log | grep -q "^ImportError: surefoot: .*planning hides" || fail "a program that imports surefoot" log
rm -r planning

echo "without PyBullet: process works, simulate says what it needs and writes nothing"
start='import sys; sys.modules["pybullet"] = None; sys.argv[0] = "surefoot"; from surefoot.cli.main import main; main()'
without() { alone "$bin/python" -P -c "$start" "$@"; }
without process live --out bare 2> log || fail "process needs PyBullet" log
if without simulate home --out never 2> log; then fail "simulate ran without PyBullet"; fi
[ "$(wc -l < log)" = 1 ] && grep -q "^surefoot: the simulation needs PyBullet" log || fail "simulate without PyBullet" log
[ ! -e never ] || fail "simulate without PyBullet left a run folder"
echo "installed: all checks passed"
