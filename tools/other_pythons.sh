#!/usr/bin/env bash
# Run tests with every other CPython from 3.11 to 3.13 that is here, by name or among pyenv's: each in a copy of the
# sources, build/pythonX.Y, with an environment of its own; what they print is in build/pythonX.Y.log.
# usage: tools/other_pythons.sh PYTHON [PYTEST ARGUMENT ...]    (PYTHON: which has been tested already)
#        tools/other_pythons.sh PYTHON --no-tests               (make their environments and leave it at that)
set -euo pipefail
if [ $# -eq 0 ]; then
  sed -n 2,5p "$0" >&2
  exit 2
fi
cd "$(dirname "$0")/.."
tested=$("$1" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
shift

find_python() {
  local candidate
  for candidate in "$(command -v "python$1")" "${PYENV_ROOT:-$HOME/.pyenv}/versions/$1".*"/bin/python$1"; do
    if "$candidate" -c '' 2>/dev/null; then # pyenv has a python3.12 on the PATH that only says what to choose
      echo "$candidate"
      return
    fi
  done
  return 1
}

copy_sources() { # COPY
  local before=$1/build/sources now=$1/build/sources.new
  [ -e "$before" ] || rm -rf "$1"
  mkdir -p "$1/build"
  git ls-files -z --cached --others --exclude-standard --deduplicate | LC_ALL=C sort -z >"$now"
  if [ -e "$before" ]; then # what was deleted must not be tested; what set-up built must stay
    LC_ALL=C comm -z -23 "$before" "$now" | (cd "$1" && xargs -0 rm -f)
  fi
  tar --create --null --files-from "$now" | tar --extract -C "$1"
  mv "$now" "$before"
}

test_with() { # VERSION PYTHON DOMAINS [PYTEST ARGUMENT ...]
  local copy=build/python$1 python=$2 domains=$3
  shift 3
  copy_sources "$copy"
  make -C "$copy" setup PYTHON="$python"
  if [ "$*" != --no-tests ]; then
    (cd "$copy" && MABIRDS_TEST_DOMAINS=$domains .venv/bin/python -m pytest "$@")
  fi
}

mkdir -p build
first=1
declare -A running
for version in 3.11 3.12 3.13; do
  [ "$version" != "$tested" ] || continue
  if ! python=$(find_python "$version"); then
    echo "== Python $version is not here"
    continue
  fi
  echo "== Python $version: $python"
  # All at the same time, each in ROS domains of its own.
  test_with "$version" "$python" "$first-$((first + 32))" "$@" >"build/python$version.log" 2>&1 &
  running[$version]=$!
  first=$((first + 33))
done

failed=0
for version in "${!running[@]}"; do
  wait "${running[$version]}" || failed=1
  echo "== Python $version" && tail -n 30 "build/python$version.log"
done
exit $failed
